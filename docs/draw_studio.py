"""The studio's page in each of its states, at three widths, light and dark; one of them stands in docs/studio.md.

python -m docs.draw_studio [FOLDER]    all states into a folder, to be looked at; without one, the page's picture alone
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.recording import ArrayFrames, Recording
from sonocal.recording.formats import write_recording
from sonocal.simulation.sample import sample_sweep
from sonocal.simulation.sweep import SimulatedSweep
from sonocal.targets import write_lines

PICTURE = Path(__file__).parent / "pictures" / "studio.png"
WIDTHS_PX, HEIGHT_PX = (390, 1280, 2560), 900
LOOKS = ("light", "dark")
ANSWERED = '#numbers:not([data-revision=""])'


def all_of_it(sweep: SimulatedSweep) -> Recording:
    return sweep.recording


def few(sweep: SimulatedSweep) -> Recording:
    return sweep.recording.select(np.arange(4))


def blank(sweep: SimulatedSweep) -> Recording:
    return replace(sweep.recording, frames=ArrayFrames(np.zeros((len(sweep.recording), 400, 400), np.uint8)))


def one_direction(sweep: SimulatedSweep, count: int = 25) -> Recording:
    """Images in which the needle points nearly one way."""
    along = sweep.recording.between("Probe", "Needle").matrices[:, :3, 2]
    return sweep.recording.select(np.sort(np.argsort(-(along @ along[0]))[:count]))


def one_pose(sweep: SimulatedSweep) -> Recording:
    """Images in which it hardly moves."""
    return one_direction(sweep, 6)


@dataclass(frozen=True)
class State:
    """How the page comes to look so.

    Attributes:
        name: of the pictures.
        recorded: what is shown.
        done: to the page, once it answered; with the server's process.
        answered: whether an answer is waited for.
    """

    name: str
    recorded: Callable[[SimulatedSweep], Recording] = all_of_it
    done: Callable[[Any, subprocess.Popen[str]], None] = lambda tab, server: None
    answered: bool = True


def exported(tab: Any, server: subprocess.Popen[str]) -> None:
    tab.keyboard.press("e")
    tab.wait_for_selector("#files li", timeout=60_000)


def lost(tab: Any, server: subprocess.Popen[str]) -> None:
    server.kill()
    tab.wait_for_selector("#banner.stop")


def dropped(tab: Any, server: subprocess.Popen[str]) -> None:
    tab.keyboard.press("n")
    tab.keyboard.press("x")
    tab.wait_for_timeout(1000)


STATES = (
    State("good"),
    State("dropped", done=dropped),
    State("exported", done=exported),
    State("lost", done=lost),
    State("looking", answered=False),
    State("too-few", few),
    State("no-needle", blank),
    State("warned", one_direction),
    State("degenerate", one_pose),
)


@contextmanager
def studio(
    folder: Path, recording: Recording, sweep: SimulatedSweep
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A studio on a recording: its address and process."""
    source, lines = folder / "sweep.igs.mha", folder / "needle.toml"
    write_recording(recording, source)
    write_lines(sweep.lines, lines)
    command = [sys.executable, "-m", "sonocal", "studio", str(source), "--lines", str(lines), "--no-browser"]
    server = subprocess.Popen(
        [*command, "-o", str(folder / "studio")], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        assert server.stdout is not None
        said = re.search(r"http://\S+", server.stdout.readline())
        assert said is not None
        yield said[0], server
    finally:
        server.kill()
        server.communicate()


def draw(state: State, browser: Any, paths: dict[tuple[int, str], Path]) -> None:
    """Pictures of the page, by width and look, all of one studio."""
    sweep = sample_sweep()
    with (
        tempfile.TemporaryDirectory() as folder,
        studio(Path(folder), state.recorded(sweep), sweep) as (address, server),
    ):
        tabs = {}
        first = browser.new_context()
        first.new_page().goto(address)  # the key is good once: the others get its cookie
        for width_px, look in paths:
            context = browser.new_context(
                viewport={"width": width_px, "height": HEIGHT_PX},
                color_scheme=look,
                storage_state=first.storage_state(),
            )
            tab = tabs[width_px, look] = context.new_page()
            tab.goto(address.split("?")[0])
            tab.wait_for_selector(ANSWERED if state.answered else "#frame[data-frame]", timeout=120_000)
        state.done(tab, server)
        tab.wait_for_timeout(1000)
        for key, path in paths.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            tabs[key].screenshot(path=str(path), full_page=True)
            tabs[key].context.close()
        first.close()


def main() -> None:
    """Draw."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--states", nargs="+", default=[state.name for state in STATES])
    arguments = parser.parse_args()
    with sync_playwright() as api:
        browser = api.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox", "--disable-gpu"]
        )
        if arguments.folder is None:
            draw(STATES[0], browser, {(1280, "light"): PICTURE})
            return
        for state in STATES:
            if state.name in arguments.states:
                keys = [(width_px, look) for width_px in WIDTHS_PX for look in LOOKS]
                draw(
                    state,
                    browser,
                    {key: arguments.folder / f"{state.name}-{key[0]}-{key[1]}.png" for key in keys},
                )
                print(state.name, flush=True)


if __name__ == "__main__":
    main()
