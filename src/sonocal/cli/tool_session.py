"""The part of ``sonocal tool`` that reads a long recording of several tools without cutting it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.options import console, typed
from sonocal.cli.outputs import reserve
from sonocal.cli.screen.plain import say, say_json
from sonocal.cli.told import refuse_units, unit_doubts
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.recording import Recording
    from sonocal.tools import ToolSession

__all__ = ["OF_SESSIONS", "read_session"]

# Options that mean something with --session alone, and those that mean nothing with it.
OF_SESSIONS = ("page",)
OF_ONE_TOOL = (
    *("tool_name", "spin", "second", "spin_frames", "second_frames", "length_mm", "expected", "landmarks"),
    *("into", "in_order", "dragged", "stepper", "name"),
)


def read_session(
    recording: Recording, output: Path | None, options: dict[str, Any], *, as_json: bool
) -> None:
    """Find what tools did, show it, and write the tips and needles.

    Args:
        recording: of the tools.
        output: targets (.toml); nothing is written if None.
        options: of the command.
        as_json: print for programs.
    """
    from sonocal.cli.screen.tool_session import print_tool_session, session_record
    from sonocal.cli.tips import place_of_tip
    from sonocal.files import write_into_folder
    from sonocal.tools import find_tool_session

    if names := typed(OF_ONE_TOOL):
        raise click.UsageError(f"{names[0]} is for one tool, and --session finds what all did; leave one out")
    page = options["page"]
    reserve(*(path for path in (output, page) if path is not None))
    refuse_units(recording.name, unit_doubts(recording), accepted=options["accept_units"])
    stylus, tip = options["stylus"], options["stylus_tip"]
    found = find_tool_session(
        recording,
        reference=options["reference"],
        tips_mm={} if stylus is None else {stylus: place_of_tip(tip, stylus)},
        on_invalid=options["on_invalid"],
        seed=options["seed"],
    )
    refuse_units(recording.name, found.diagnostics, accepted=options["accept_units"])
    files = {}
    if output is not None:
        files[output] = _targets(found, output)
    if page is not None:
        files[page] = _page(found)
    reserve(*files)
    for path, content in files.items():
        write_into_folder(path.parent, {path.name: content})
    if as_json:
        say_json(session_record(found))
        return
    print_tool_session(console(), found)
    for path in files:
        say(f"Wrote {path}")


def _targets(found: ToolSession, output: Path) -> bytes:
    """Tips as points and needles as lines, each in its marker's frame."""
    from dataclasses import replace

    from sonocal.targets import Point, lines_toml

    needles = [(name, one.needle.line) for name, one in found.tools.items() if one.needle is not None]
    lines = [line if len(needles) == 1 else replace(line, name=name.lower()) for name, line in needles]
    tips = [(name, one.points[0].tip_mm) for name, one in found.tools.items() if one.points]  # type: ignore[union-attr]
    points = [Point("tip" if len(tips) == 1 else f"tip of {name}", name, tip) for name, tip in tips]
    if not lines and not points:
        raise InputError(
            f"{output}: nothing is to be written, for no tool of {found.name} was pivoted; rest a tip in a divot and "
            "tilt the tool by 30 deg to all sides for ten seconds"
        )
    return lines_toml(str(output), lines, points, [f"mm, each in its marker's frame, from {found.name}"])


def _page(found: ToolSession) -> bytes:
    from sonocal.cli.screen.tool_session import stretch_in_words
    from sonocal.report.tool_sessions import tool_session_html

    start = found.times_s
    rows = [
        (one.tool, one.kind, f"{start[one.first]:.1f}", f"{start[one.last]:.1f}", stretch_in_words(one))
        for one in found.stretches
    ]
    return tool_session_html(found, rows)
