"""``sonocal studio``: the page in a browser."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

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
    from sonocal.studio import Begin

__all__ = ["open_studio", "studio"]

READING_LATER = tuple(name for name in READING if name not in ("latency_s", "on_invalid"))
"""Of reading, what is not said by how a scan was recorded."""


@command(
    "Look at a sweep in the browser, and mend its points.",
    groups={
        "What is read": ("lines", *READING),
        "A scan that goes on": ("live", "image", "until_mm", "most_tilt_deg"),
        "What is written": ("output",),
        "Where the page is": ("host", "port", "browser"),
    },
    examples=(
        "sonocal studio",
        "sonocal studio sweep.igs.mha --lines needle.toml",
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
    **options: Any,
) -> None:
    """Open a local web page: look at frames with what was detected, click where the detector was wrong, and see
    verdict and predicted error follow.

    INPUT is a recording, or a table of sightings; without one, drop a file into the page.

    With --live the page follows a scan: the newest image, the error as it falls, and which pose to hold next. What
    arrives is in OUTPUT/recording.mhd as soon as it is there; at the end it is opened like any recording.

    Every click is kept in OUTPUT/session.jsonl as it is made: run the same again, and nothing is lost. What is exported
    is what "sonocal calibrate" writes of the same points. Nothing leaves this machine, and nothing is fetched.
    """  # noqa: D205
    from sonocal.errors import InputError

    _refuse_halves(source, lines, live)
    for path in (source, lines):
        if path is not None and not path.exists():
            raise InputError(f"{path}: there is no such file; check the name and the folder")
    first = [path for path in (source, lines) if path is not None]
    how: dict[str, Any] = {"host": host, "port": port, "browser": browser}
    if live is None:
        open_studio(first, output, **how, reading=_typed_again(READING))
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


def open_studio(
    first: Sequence[Path],
    output: Path,
    *,
    host: str,
    port: int,
    browser: bool,
    reading: Sequence[str] = (),
    begin: Begin | None = None,
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
    """
    from sonocal.cli.screen.terminal import somebody_looks
    from sonocal.cli.studio_work import Openings
    from sonocal.studio import serve

    def ready(address: str) -> None:
        say(f"Studio: {address}")
        say("The address is good once, for one browser. Ctrl+C ends the studio; every click is kept.")
        if browser and somebody_looks():
            click.launch(address)

    opener = Openings(output, reading).open
    kept = RECORDING, IMAGES
    serve(output, opener, first, host=host, port=port, begin=begin, recorded=kept, ready=ready)


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
