"""A live calibration on a terminal, and as plain lines where there is none."""

from __future__ import annotations

from collections.abc import Iterator

from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from sonocal.cli.screen.parts import verdict_text
from sonocal.live import State

__all__ = ["line_of", "screen_of"]

BARS = "▁▂▃▄▅▆▇█"
WIDTH = 40
MOST_SAID = 4
SHADES = " ░▒▓█"


def line_of(state: State) -> str:
    """A moment in one line."""
    parts = [f"{state.elapsed_s:6.1f} s: {state.recorded} images recorded, {state.paired} with every pose"]
    parts.append(f"needle in {state.used} of {state.looked}")
    parts.append(_expected(state))
    if state.latency is not None:
        parts.append(_lag(state))
    if lost := _lost(state):
        parts.append(lost)
    return "; ".join(part for part in parts if part)


def screen_of(state: State, *, until_mm: float | None = None) -> RenderableType:
    """A moment as a screen of a terminal."""
    table = Table.grid(padding=(0, 2))
    for name, text in _rows(state, until_mm):
        table.add_row(Text(name, style="dim"), text)
    parts: list[RenderableType] = [_headline(state), table]
    if state.cells:
        parts.append(Columns([_coverage(state), _fall(state, until_mm)], padding=(0, 4)))
    if state.advice:
        parts.append(Text.assemble(("Next: ", "bold"), state.advice))
    if state.hold is not None and not state.ended:
        parts.append(Text(state.hold.sketch(), style="cyan"))
    parts += [Text(f"{at_s:6.1f} s  {what}", style="yellow") for at_s, what in state.said[-MOST_SAID:]]
    ended = f"Ends: {state.ended}" if state.ended else "q, enter or ctrl-C: end, calibrate and write"
    return Panel(Group(*parts, Text(ended, style="dim")), title="sonocal live", title_align="left")


def _headline(state: State) -> Text:
    if state.refusal:
        return Text.assemble(("Not yet: ", "bold yellow"), state.refusal)
    if state.verdict is None:
        return Text("Waits for images and poses" if not state.images else "Looks at the first images", "bold")
    return verdict_text(state.verdict)


def _rows(state: State, until_mm: float | None) -> Iterator[tuple[str, Text]]:
    images = f"{state.recorded} recorded, {state.paired} with every pose, {state.looked} looked into"
    yield "images", Text(f"{images} ({state.elapsed_s:.0f} s)")
    yield "needle", Text(f"stands out in {state.with_candidates}, {state.used} sightings agree")
    if state.expected_mm is not None:
        wanted = "" if until_mm is None else f", ends below {until_mm:g} mm"
        yield "error", Text(_expected(state) + wanted, style="bold")
    yield "tracker", _tools(state)
    if state.latency is not None:
        yield "latency", Text(_lag(state))
    if lost := _lost(state):
        yield "lost", Text(lost, style="yellow")


def _tools(state: State) -> Text:
    if not state.connected:
        return Text("not connected", style="bold red")
    text = Text()
    for tool in state.tools:
        text.append("● " if tool.seen else "○ ", style="green" if tool.seen else "red")
        text.append(f"{tool.name} ({tool.share:.0%})  ")
    return text if state.tools else Text("no pose yet", style="yellow")


def _coverage(state: State) -> RenderableType:
    most = max(max(row) for row in state.cells) or 1
    grid = Text("seen in the image\n", style="dim")
    for row in state.cells:
        for cell in row:
            shade = SHADES[min(len(SHADES) - 1, -(-cell * (len(SHADES) - 1) // most))]
            grid.append(shade * 4, style="not dim green")
        grid.append("\n")
    if state.tilts_deg is not None:
        grid.append("tilted {:.0f} to {:.0f} degrees".format(*state.tilts_deg))
    return grid


def _fall(state: State, until_mm: float | None) -> RenderableType:
    import math

    values = [error for _, error in state.history][-WIDTH:]
    if not values:
        return Text("")
    low = math.log(min([*values, until_mm or min(values)]))
    high = max(math.log(max(values)), low + 1e-9)
    steps = [int((math.log(one) - low) / (high - low) * (len(BARS) - 1)) for one in values]
    text = Text("predicted error (95 %), a bar a fit\n", style="dim")
    text.append("".join(BARS[max(step, 0)] for step in steps), style="not dim cyan")
    text.append(f"\n{values[0]:.1f} to {values[-1]:.2f} mm")
    return text


def _expected(state: State) -> str:
    if state.refusal:
        return f"no calibration yet: {state.refusal}"
    if state.expected_mm is None:
        return ""
    return f"predicted error up to {state.expected_mm:.2f} mm (95 %)"


def _lag(state: State) -> str:
    assert state.latency is not None
    lag = state.latency
    late = f"{1e3 * abs(lag.latency_s):.0f} ms {'later' if lag.latency_s >= 0 else 'earlier'}"
    return f"the tracker stamps {late} than the scanner (+- {1e3 * lag.within_s:.0f} ms)"


def _lost(state: State) -> str:
    counts = {
        "dropped, for they came too fast": state.dropped,
        "damaged": state.damaged,
        "too late": state.late,
    }
    return ", ".join(f"{count} messages {what}" for what, count in counts.items() if count)
