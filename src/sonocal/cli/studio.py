"""``sonocal studio``: the page in a browser."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.existing import choice_of, of_other_software
from sonocal.cli.help import READING, command
from sonocal.cli.live_begin import IMAGE, IMAGES, MOST_TILT, RECORDING, UNTIL
from sonocal.cli.options import (
    ANGLES,
    FILE,
    INVALID,
    LATENCY_OR_ESTIMATE,
    LINES,
    MARKERS,
    POSES,
    PROBE,
    output_folder,
    typed,
)
from sonocal.cli.screen.plain import say
from sonocal.cli.studio_live import scan_to_follow

if TYPE_CHECKING:
    from sonocal.existing import Choice
    from sonocal.studio import Asked, Begin

__all__ = ["open_studio", "studio"]

READING_LATER = tuple(name for name in READING if name not in ("latency_s", "on_invalid"))
"""Of reading, what is not said by how a scan was recorded."""


@command(
    "Look at a sweep in the browser, and mend its points.",
    groups={
        "What is read": ("lines", *READING),
        "What it is compared with": ("compare", "transform", "stored_as"),
        "The needle, where no file says it": ("pivot", "spin", "tool_name", "length_mm"),
        "A scan that goes on": ("live", "image", "until_mm", "most_tilt_deg"),
        "What is written": ("output",),
        "Where the page is": ("host", "port", "browser"),
    },
    examples=(
        "sonocal studio",
        "sonocal studio sweep.igs.mha --lines needle.toml",
        "sonocal studio sweep.igs.mha --lines needle.toml --compare plus.xml",
        "sonocal studio sweep.igs.mha --pivot pivot.igs.mha --spin spin.igs.mha",
        "sonocal studio --live localhost:18944 --lines needle.toml",
        "sonocal studio sweep.igs.mha --lines needle.toml --no-browser --port 8800 -o mended",
    ),
)
@click.argument("source", metavar="[INPUT]", type=FILE, required=False)
@LINES
@POSES
@ANGLES
@MARKERS
@PROBE
@LATENCY_OR_ESTIMATE
@INVALID
@click.option("--compare", type=FILE, metavar="OTHER", help="Another calibration, ours or of other software.")
@of_other_software
@click.option("--pivot", type=FILE, help="Recording of the needle tilted about its resting tip.")
@click.option("--spin", type=FILE, help="Recording of it turned about its shaft.")
@click.option(
    "--tool", "tool_name", default="Needle", show_default=True, help="What the needle's marker is called."
)
@click.option(
    "--length",
    "length_mm",
    type=click.FloatRange(0, min_open=True),
    help="Of the shaft from its tip, mm.  [default: to beside the marker]",
)
@click.option(
    "--live",
    metavar="HOST[:PORT]",
    help="Follow a scan from an OpenIGTLink server, recorded into OUTPUT; port 18944 unless said.",
)
@IMAGE
@UNTIL
@MOST_TILT
@output_folder("studio", "the journal of what was clicked, and what is exported")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on; another lets other machines in, unencrypted, with the key of the printed address.",
)
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Port to listen on.  [default: one that is free]"
)
@click.option(
    "--no-browser", "browser", is_flag=True, flag_value=False, default=True, help="Open no browser."
)
def studio(
    source: Path | None,
    output: Path,
    *,
    lines: Path | None,
    host: str,
    port: int,
    browser: bool,
    live: str | None,
    pivot: Path | None,
    spin: Path | None,
    compare: Path | None,
    **options: Any,
) -> None:
    """Open a local web page: look at frames with what was detected, click where the detector was wrong, and see
    verdict and predicted error follow.

    INPUT is a recording, or a table of sightings; without one, drop a file into the page.

    With --pivot and --spin the needle is found first, as "sonocal tool" does; the page does the same of what is dropped
    there.

    With --compare the page says how far another calibration is from the one of the sweep, as "sonocal validate" does,
    and so it does of one that is given under Files.

    With --live the page follows a scan: the newest image, the error as it falls, and which pose to hold next. What
    arrives is in OUTPUT/recording.mhd as soon as it is there; at the end it is opened like any recording.

    Every click is kept in OUTPUT/session.jsonl as it is made: run the same again, and nothing is lost. What is exported
    is what "sonocal calibrate" writes of the same points. Nothing leaves this machine, and nothing is fetched.
    """  # noqa: D205
    from sonocal.errors import InputError

    _refuse_halves(source, lines, live)
    asked = _needle(pivot, spin, lines, live, options)
    choice = choice_of(options)
    if compare is None and (named := typed(("transform", "stored_as"))):
        raise click.UsageError(f"{named[0]} is for --compare, which is missing")
    for path in (source, lines, pivot, spin, compare):
        if path is not None and not path.exists():
            raise InputError(f"{path}: there is no such file; check the name and the folder")
    first = [path for path in (source, lines) if path is not None]
    how: dict[str, Any] = {"host": host, "port": port, "browser": browser, "other": compare, "choice": choice}
    if live is None:
        open_studio(first, output, **how, reading=_typed_again(READING), needle=asked)
        return
    assert lines is not None
    reading = _typed_again(READING_LATER)
    begin = scan_to_follow(live, lines, output, options, reading)
    open_studio((), output, **how, reading=reading, begin=begin)


def _refuse_halves(source: Path | None, lines: Path | None, live: str | None) -> None:
    if live is not None and source is not None:
        raise click.UsageError("--live records a scan of its own; leave INPUT out")
    if live is not None and lines is None:
        raise click.UsageError("--live follows a needle; say with --lines where it is in its marker's frame")
    if source is None and lines is not None and live is None:
        raise click.UsageError("--lines says what an INPUT shows; name the recording, too")
    for name in typed(("image", "until_mm", "most_tilt_deg")) if live is None else ():
        raise click.UsageError(f"{name} is for --live, which is missing")


def _needle(
    pivot: Path | None, spin: Path | None, lines: Path | None, live: str | None, options: dict[str, Any]
) -> Asked | None:
    """What the needle is to be found from."""
    from sonocal.studio import Asked

    if pivot is None and spin is None:
        for name in typed(("tool_name", "length_mm")):
            raise click.UsageError(f"{name} is for --pivot and --spin, which are missing")
        return None
    if lines is not None or live is not None:
        raise click.UsageError(
            "--pivot and --spin find the needle that --lines would say, of a sweep that is recorded; leave one out"
        )
    return Asked(pivot, spin, options["tool_name"], options["length_mm"])


def open_studio(
    first: Sequence[Path],
    output: Path,
    *,
    host: str,
    port: int,
    browser: bool,
    reading: Sequence[str] = (),
    begin: Begin | None = None,
    needle: Asked | None = None,
    other: Path | None = None,
    choice: Choice | None = None,
) -> None:
    """Serve the page until somebody interrupts.

    Args:
        first: a recording and perhaps its targets, or a table.
        output: folder of the journal and of what is exported.
        host: to listen on.
        port: 0 for one that is free.
        browser: whether to open one, where somebody looks.
        reading: further arguments of ``sonocal calibrate``.
        begin: a live session that the page follows.
        needle: what the needle is found from.
        other: a calibration to compare with.
        choice: which matrix of a file of other software that is.
    """
    from sonocal.cli.screen.terminal import somebody_looks
    from sonocal.cli.studio_work import Openings
    from sonocal.studio import serve

    def ready(address: str) -> None:
        say(f"Studio: {address}")
        say("The address is good once, for one browser. Ctrl+C ends the studio; every click is kept.")
        if browser and somebody_looks():
            click.launch(address)

    openings = Openings(output, reading, choice)
    how: dict[str, Any] = {"host": host, "port": port, "ready": ready, "other": other}
    how |= {"begin": begin, "recorded": (RECORDING, IMAGES), "needle": needle}
    serve(output, openings.open, openings.tool, openings.other, first, **how)


def _typed_again(names: Sequence[str]) -> list[str]:
    """Those options that stand on the command line, as arguments for another command."""
    context = click.get_current_context()
    again: list[str] = []
    for option in context.command.params:
        if option.name in names and typed((option.name,)):
            value = context.params[option.name]
            for one in value if isinstance(value, tuple) else (value,):
                again += [option.opts[0], str(one)]
    return again
