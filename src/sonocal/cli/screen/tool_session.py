"""What the command line shows of a long recording of tools: a time line, what was done, what follows of each tool."""

from __future__ import annotations

import numpy as np
from rich.console import Console
from rich.text import Text

from sonocal.cli.screen.parts import print_findings
from sonocal.cli.screen.recording import print_tool
from sonocal.cli.screen.tables import NumberTable
from sonocal.tools import PivotCalibration, Rest, SpinCalibration, Stretch, ToolSession

__all__ = ["print_tool_session", "session_record", "stretch_in_words"]

SIGNS = {"pivot": ("P", "green"), "spin": ("S", "cyan"), "touch": ("T", "magenta"), "still": ("_", "dim")}
MOVED, LOST = ".", " "
LEGEND = "P pivot, S spin, T touch, _ still, . moved, blank: not seen"
LEAST_COLUMNS, MOST_COLUMNS = 20, 100


def print_tool_session(console: Console, found: ToolSession) -> None:
    """The time line, a row a stretch, then every tool that was pivoted or spun."""
    _print_line(console, found)
    table = NumberTable(
        f"What was done, places in mm in {found.reference}", "from, s", "to, s", "items", first="tool"
    )
    told = [one for one in found.stretches if one.kind != "still"]
    for one in told:
        items = f"{one.first}-{one.last}"
        name = f"{one.tool}: {one.kind}, {stretch_in_words(one)}"
        start = found.times_s[one.first]
        table.add_row(name, f"{start:.1f}", f"{start + one.end_s - one.start_s:.1f}", items)
    console.print(table)
    for name, tool in found.tools.items():
        console.print(Text(name, style="bold"))
        print_tool(console, tool)
    others = {one for tool in found.tools.values() for one in tool.diagnostics}
    print_findings(console, [one for one in found.diagnostics if one not in others])


def stretch_in_words(one: Stretch) -> str:
    """What a stretch told."""
    if isinstance(one.found, PivotCalibration):
        return f"tip to +-{one.found.tip_95_mm:.2f}, {one.found.rms_mm:.2f} mm rms"
    if isinstance(one.found, SpinCalibration):
        return f"turned by {one.found.turn_deg:.0f} deg rms, wobble {one.found.wobble_deg:.2f} deg"
    if isinstance(one.found, Rest):
        return "at " + ", ".join(f"{x:.1f}" for x in one.found.point_mm)
    return "lay"


def session_record(found: ToolSession) -> dict[str, object]:
    """A session for programs: without the items of each stretch one by one."""
    names = ("tool", "kind", "first", "last", "start_s", "end_s", "found")
    stretches = [{name: getattr(one, name) for name in names} for one in found.stretches]
    return {
        "name": found.name,
        "reference": found.reference,
        "stretches": stretches,
        "tools": dict(found.tools),
        "diagnostics": found.diagnostics,
    }


def _print_line(console: Console, found: ToolSession) -> None:
    widest = max(len(name) for name in found.seen)
    columns = int(np.clip(console.width - widest - 2, LEAST_COLUMNS, MOST_COLUMNS))
    edges = np.linspace(0, found.times_s[-1], columns + 1)
    for name, seen in found.seen.items():
        line = Text(f"{name:<{widest}} ")
        middle = (edges[1:] + edges[:-1]) / 2
        items = np.clip(np.searchsorted(found.times_s, middle), 0, len(seen) - 1)
        bounds = np.searchsorted(found.times_s, edges)
        for item, low, high in zip(items, bounds[:-1], bounds[1:], strict=True):
            kind = next(
                (s.kind for s in found.stretches if s.tool == name and s.first <= item <= s.last), None
            )
            sign, colour = SIGNS[kind] if kind else ((MOVED if seen[low : high + 1].any() else LOST), "dim")
            line.append(sign, style=colour)
        console.print(line)
    console.print(Text(f"{'':<{widest}} 0 to {found.times_s[-1]:.0f} s: {LEGEND}", style="dim"))
