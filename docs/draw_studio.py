"""The studio's page in each of its states, at three widths, light and dark; some stand in docs/studio.md.

python -m docs.draw_studio [FOLDER]    all states into a folder, to be looked at; without one, those of the page alone
"""

from __future__ import annotations

import argparse
import re
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.recording import ArrayFrames, Poses, Recording
from sonocal.recording.formats import write_recording
from sonocal.simulation.sample import sample_sweep
from sonocal.simulation.sweep import SimulatedSweep
from sonocal.targets import write_lines

PICTURES = Path(__file__).parent / "pictures"
KEPT = {"good": "studio.png", "scan": "studio-scan.png"}
"""The pictures of docs/studio.md, by their state."""
WIDTHS_PX, HEIGHT_PX = (390, 1280, 2560), 900
TOLD = "#far.use, #far.care, #far.stop"
TIP_MM = 210.0
LOOKS = ("light", "dark")
IMAGE = "#frame[data-frame]"
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
        ready: what is waited for.
        live: whether it is played to the page as a scan.
        turned: whether a pivot and a spin are there to find the needle from, in place of its file.
    """

    name: str
    recorded: Callable[[SimulatedSweep], Recording] = all_of_it
    done: Callable[[Any, subprocess.Popen[str]], None] = lambda tab, server: None
    ready: str = ANSWERED
    live: bool = False
    turned: bool = False


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


def answered(tab: Any, server: subprocess.Popen[str]) -> None:
    tab.wait_for_selector("#verdict.use, #verdict.care", timeout=120_000)


def scanned(tab: Any, server: subprocess.Popen[str]) -> None:
    """Long enough for the curve to fall, and for the volume to begin."""
    tab.wait_for_selector("#far.use", timeout=300_000)
    tab.wait_for_selector("#slices canvas", timeout=120_000)


def unplugged(tab: Any, server: subprocess.Popen[str]) -> None:
    scanned(tab, server)
    PLAYERS[server.pid].kill()
    tab.wait_for_selector("#banner.stop", timeout=60_000)


def still(sweep: SimulatedSweep) -> Recording:
    """Of which the needle hardly turns, so that a pivot of it tells no tip."""
    return one_pose(sweep)


PLAYERS: dict[int, subprocess.Popen[str]] = {}
"""What plays to a studio, by the studio's process."""
STATES = (
    State("good"),
    State("dropped", done=dropped),
    State("exported", done=exported),
    State("lost", done=lost),
    State("looking", ready=IMAGE),
    State("too-few", few),
    State("no-needle", blank),
    State("warned", one_direction),
    State("degenerate", one_pose),
    State("scan-begins", ready="#frame[data-item]", live=True),
    State("scan", ready=TOLD, done=scanned, live=True),
    State("scan-lost", ready=TOLD, done=unplugged, live=True),
    State("needle", ready="#tool-result.use", done=answered, turned=True),
    State("needle-refused", still, ready="#tool-result.stop", turned=True),
)


def turned(sweep: SimulatedSweep, steps: Any) -> Recording:
    """The needle's marker turned about its resting tip by rotation vectors (N, 3), rad."""
    from scipy.spatial.transform import Rotation

    matrices = np.tile(np.eye(4), (len(steps), 1, 1))
    rng = np.random.default_rng(1)
    jitter = Rotation.from_rotvec(rng.normal(0, np.radians(0.1), (len(steps), 3)))
    matrices[:, :3, :3] = (jitter * Rotation.from_rotvec(steps)).as_matrix()
    matrices[:, :3, 3] = rng.normal(0, 0.2, (len(steps), 3)) - matrices[:, :3, :3] @ np.array(
        [0.0, 0.0, -TIP_MM]
    )
    return Recording(np.arange(len(steps)) / 20, poses={"Needle": Poses.of("Needle", "Tracker", matrices)})


def arguments_of(state: State, folder: Path, sweep: SimulatedSweep) -> list[str]:
    """What the studio is called with; its files are written."""
    recording = state.recorded(sweep)
    write_recording(recording, folder / "sweep.igs.mha")
    write_lines(sweep.lines, folder / "needle.toml")
    if not state.turned:
        return [str(folder / "sweep.igs.mha"), "--lines", str(folder / "needle.toml")]
    t = np.linspace(0, 12, 200)
    tilts = 0.5 * np.column_stack([np.sin(t), np.cos(1.3 * t), 0.3 * np.sin(0.7 * t)])
    share = 1.0 if state.recorded is all_of_it else 0.01
    write_recording(turned(sweep, share * tilts), folder / "pivot.igs.mha")
    write_recording(turned(sweep, np.outer(np.sin(t / 4), [0, 0, 2.5])), folder / "spin.igs.mha")
    named = ["--pivot", str(folder / "pivot.igs.mha"), "--spin", str(folder / "spin.igs.mha")]
    return named if state.recorded is still else [str(folder / "sweep.igs.mha"), *named]


@contextmanager
def played(folder: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The sweep, served over and over: where, and by which process."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "sonocal", "replay", str(folder / "sweep.igs.mha"), "--loop"]
    player = subprocess.Popen([*command, "--port", str(port)], stdout=subprocess.PIPE, text=True)
    try:
        assert player.stdout is not None
        player.stdout.readline()
        yield f"localhost:{port}", player
    finally:
        player.kill()
        player.communicate()


@contextmanager
def studio(folder: Path, state: State, sweep: SimulatedSweep) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A studio in a state: its address and process."""
    with ExitStack() as stack:
        named, player = arguments_of(state, folder, sweep), None
        if state.live:
            where, player = stack.enter_context(played(folder))
            named = ["--live", where, *named[1:]]
        command = [sys.executable, "-m", "sonocal", "studio", *named, "--no-browser"]
        server = subprocess.Popen(
            [*command, "-o", str(folder / "studio")],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        if player is not None:
            PLAYERS[server.pid] = player
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
        studio(Path(folder), state, sweep) as (address, server),
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
            tab.wait_for_selector(state.ready, timeout=300_000)
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
            for state in STATES:
                if state.name in KEPT:
                    draw(state, browser, {(1280, "light"): PICTURES / KEPT[state.name]})
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
