"""``sonocal live``: calibrate while one scans."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.help import command
from sonocal.cli.live_begin import IMAGE, IMAGES, MOST_TILT, RECORDING, UNTIL, keep_in, session_of
from sonocal.cli.live_end import calibrated
from sonocal.cli.live_source import CONNECT, TOOLS, TRACKER, VIDEO, source_of
from sonocal.cli.options import (
    CENTRE,
    COUNT,
    FILE,
    INVALID,
    JSON,
    LATENCY_OR_ESTIMATE,
    NO_REPORT,
    PROBE,
    SCANNER,
    output_folder,
    typed,
)
from sonocal.cli.outputs import OVERWRITE, reserve, reserve_results
from sonocal.cli.push import PUSH, YES, push_calibration
from sonocal.cli.reading import ESTIMATE
from sonocal.cli.screen.plain import say

if TYPE_CHECKING:
    from sonocal.live import Live, State

__all__ = ["live"]

PER_S, LINE_EACH_S = 30.0, 1.0
KEYS = frozenset("qQ\r\n ")


@command(
    "Calibrate while scanning, from an OpenIGTLink server.",
    groups={
        "What is read": ("connect", "lines", "image", "probe", "latency_s", "on_invalid"),
        "Devices without a server": ("tracker", "tools", "video"),
        "How the needle is found in images": ("count", "centre"),
        "When it ends, and how it guides": ("until_mm", "most_images", "seconds", "most_tilt_deg"),
        "What is known of the set-up": ("scanner_mm_per_px",),
        "What is written and shown": ("output", "tolerance_mm", "report", "overwrite", "as_json"),
        "Into a running program": ("push", "yes"),
    },
    examples=(
        "sonocal live --connect localhost:18944 --lines needle.toml",
        "sonocal live --connect localhost:18944 --lines needle.toml --until 0.5mm -o today",
        "sonocal live --connect 192.168.0.7 --lines needle.toml --images 60 --no-report --json -o quick",
        "sonocal live --tracker optitrack --video /dev/video0 --lines needle.toml --latency estimate",
    ),
)
@CONNECT
@TRACKER
@TOOLS
@VIDEO
@click.option(
    "--lines",
    "--targets",
    "lines",
    type=FILE,
    required=True,
    help="The needle or wires: needle.toml or a PLUS device set (XML).",
)
@IMAGE
@PROBE
@LATENCY_OR_ESTIMATE
@INVALID
@COUNT
@CENTRE
@UNTIL
@click.option("--images", "most_images", type=click.IntRange(1), help="End behind so many images.")
@click.option(
    "--seconds", type=click.FloatRange(0, min_open=True), help="End after so long.  [default: never]"
)
@MOST_TILT
@SCANNER
@output_folder("live", "the recording, as it comes, and what is calibrated of it")
@click.option(
    "--tolerance-mm",
    type=float,
    default=2.0,
    show_default=True,
    help="Warn where the predicted error (95 %) at a corner of the image, or of the area seen, exceeds this.",
)
@NO_REPORT
@OVERWRITE
@JSON
@PUSH
@YES
def live(
    output: Path,
    *,
    connect: str | None,
    tracker: str | None,
    tools: tuple[str, ...],
    video: str | None,
    lines: Path,
    image: str,
    until_mm: float | None,
    most_images: int | None,
    seconds: float | None,
    most_tilt_deg: float,
    push: str | None,
    yes: bool,
    **options: Any,
) -> None:
    """Calibrate while scanning: move the needle through the image, and be told how good it is already.

    Images and poses come from an OpenIGTLink server: PLUS, 3D Slicer, a scanner's toolkit, or "sonocal replay"; or from
    a tracker and a frame grabber that have none, with stamps of when each arrived (see --latency estimate). What
    arrives is in OUTPUT/recording.mhd as soon as it is there, whatever happens then. Poses that are not rigid are left
    out unless --on-invalid says otherwise.

    At the end, by itself with --until, or with a key, OUTPUT gets what "sonocal calibrate OUTPUT/recording.mhd" makes
    of the recording: calibration.json, observations.csv, the contact sheet and the report.

    With --push the calibration then goes into a running PlusServer, which is asked about first.

    A server that goes is waited for; what goes wrong is said, and the session goes on.
    """
    from sonocal import igtl
    from sonocal.live import GREETING, Guide, Live, Pairing
    from sonocal.sweep import Reach

    if push is not None:
        igtl.address(push)  # what is wrong with it is said before the scan
    elif yes:
        raise click.UsageError("--yes is for --push")
    if not typed(("on_invalid",)):
        options["on_invalid"] = "skip"
    session = session_of(lines, options)
    names = (
        "calibration.json",
        "observations.csv",
        "contact-sheet.png",
        *(["report.html"] * options["report"]),
    )
    reserve(output / RECORDING, output / IMAGES)
    reserve_results(output, names)
    told_s = 0.0 if options["latency_s"] == ESTIMATE else options["latency_s"]
    with ExitStack() as stack:
        source = stack.enter_context(source_of(connect, tracker, tools, video))
        client = stack.enter_context(igtl.Client(source.host, source.port, greeting=GREETING))
        keep_in(session, output)
        stack.callback(session.close)
        pairing = Pairing(image, told_s)
        guide = Guide(session, Reach(most_tilt_deg=most_tilt_deg))
        running = stack.enter_context(
            Live(client, session, pairing=pairing, until_mm=until_mm, most_images=most_images, advice=guide)
        )
        with source.feeding(running.stop):
            _follow(running, until_mm, seconds)
        client.close()
        found = calibrated(running, output, lines, options, RECORDING)
    if push is not None:
        frames = "Image", str(options["probe"])
        push_calibration(found, push, "plus", frames, yes=yes, err=bool(options["as_json"]))


def _follow(running: Live, until_mm: float | None, seconds: float | None) -> None:
    """Show it until it ends: by itself, after some time, by a key or ctrl-C."""
    from sonocal.cli.screen.keys import keys

    end_s = float("inf") if seconds is None else time.monotonic() + seconds
    try:
        with _shown(until_mm) as show, keys() as pressed:
            while not running.wait(1.0 / PER_S):
                show(running.state)
                if KEYS & set(pressed()):
                    running.stop("a key was pressed")
                elif time.monotonic() > end_s:
                    running.stop(f"{seconds:g} s are over")
            show(running.state)
    except KeyboardInterrupt:
        running.stop("interrupted")
    say(f"Ends: {running.state.ended}; calibrates {running.state.recorded} images", err=True)


@contextmanager
def _shown(until_mm: float | None) -> Iterator[Any]:
    """A screen on a terminal; where there is none, a line now and then, and each sentence once; on stderr."""
    from rich.live import Live as Screen

    from sonocal.cli.screen.live import line_of, screen_of
    from sonocal.cli.screen.terminal import Terminal

    errors = Terminal(stderr=True, highlight=False)
    if not errors.is_terminal or errors.is_dumb_terminal:
        yield _Lines(line_of)
        return
    with Screen(console=errors, auto_refresh=False, transient=False) as screen:
        yield lambda state: screen.update(screen_of(state, until_mm=until_mm), refresh=True)


class _Lines:
    """Prints a moment as a line, each second, and what went wrong when it did."""

    def __init__(self, line_of: Any) -> None:
        self._line_of, self._next_s, self._said = line_of, 0.0, (-1.0, "")
        self._news: tuple[Any, ...] = ()

    def __call__(self, state: State) -> None:
        for at_s, sentence in state.said:
            if (at_s, sentence) > self._said:
                self._said = (at_s, sentence)
                say(f"{at_s:6.1f} s: {sentence}", err=True)
        news = (state.images, state.looked, state.fits, state.ended)
        if (state.elapsed_s >= self._next_s and news != self._news) or state.ended:
            self._next_s, self._news = state.elapsed_s + LINE_EACH_S, news
            say(self._line_of(state), err=True)
