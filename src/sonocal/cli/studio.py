"""``sonocal studio``: the page in a browser."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from sonocal.cli.help import READING, command
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

__all__ = ["open_studio", "studio"]


@command(
    "Look at a sweep in the browser, and mend its points.",
    groups={
        "What is read": ("lines", *READING),
        "What is written": ("output",),
        "Where the page is": ("host", "port", "browser"),
    },
    examples=(
        "sonocal studio",
        "sonocal studio sweep.igs.mha --lines needle.toml",
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
    source: Path | None, output: Path, *, lines: Path | None, host: str, port: int, browser: bool, **_: Any
) -> None:
    """Open a local web page: look at frames with what was detected, click where the detector was wrong, and see
    verdict and predicted error follow.

    INPUT is a recording, or a table of sightings; without one, drop a file into the page.

    Every click is kept in OUTPUT/session.jsonl as it is made: run the same again, and nothing is lost. What is exported
    is what "sonocal calibrate" writes of the same points. Nothing leaves this machine, and nothing is fetched.
    """  # noqa: D205
    from sonocal.errors import InputError

    if source is None and lines is not None:
        raise click.UsageError("--lines says what an INPUT shows; name the recording, too")
    for path in (source, lines):
        if path is not None and not path.exists():
            raise InputError(f"{path}: there is no such file; check the name and the folder")
    first = [path for path in (source, lines) if path is not None]
    open_studio(first, output, host=host, port=port, browser=browser, reading=_typed_again())


def open_studio(
    first: Sequence[Path], output: Path, *, host: str, port: int, browser: bool, reading: Sequence[str] = ()
) -> None:
    """Serve the page until somebody interrupts.

    Args:
        first: a recording and perhaps its targets, or a table.
        output: folder of the journal and of what is exported.
        host: to listen on.
        port: 0 for one that is free.
        browser: whether to open one, where somebody looks.
        reading: further arguments of ``sonocal calibrate``.
    """
    from sonocal.cli.screen.terminal import somebody_looks
    from sonocal.cli.studio_work import Openings
    from sonocal.studio import serve

    def ready(address: str) -> None:
        say(f"Studio: {address}")
        say("The address is good once, for one browser. Ctrl+C ends the studio; every click is kept.")
        if browser and somebody_looks():
            click.launch(address)

    serve(output, Openings(output, reading).open, first, host=host, port=port, ready=ready)


def _typed_again() -> list[str]:
    """The options of reading that stand on the command line, as arguments for another command."""
    context = click.get_current_context()
    again: list[str] = []
    for option in context.command.params:
        if option.name in READING and typed((option.name,)):
            value = context.params[option.name]
            for one in value if isinstance(value, tuple) else (value,):
                again += [option.opts[0], str(one)]
    return again
