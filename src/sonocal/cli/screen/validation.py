"""What `sonocal validate` shows: warnings, the verdict, the numbers with their meaning, the comparison."""

from __future__ import annotations

import math

from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from sonocal.calibration import Calibration
from sonocal.cli.screen.parts import print_findings, standing, verdict_text
from sonocal.cli.screen.tables import NumberTable
from sonocal.validation import (
    Comparison,
    PointSightings,
    Quantity,
    Validation,
    give_verdict,
)

__all__ = ["print_point_sightings", "print_validation"]


def print_validation(
    console: Console,
    calibration: Calibration,
    validation: Validation,
    comparison: Comparison | None = None,
    other: str = "the other calibration",
) -> None:
    """Warnings, verdict, numbers, comparison, findings."""
    findings = [*calibration.diagnostics, *validation.diagnostics]
    print_findings(console, findings, "warning")
    console.print(verdict_text(give_verdict(calibration, validation)))
    console.print()
    if validation.quantities:
        console.print(_numbers(validation))
        console.print(Text("What they are:", style="bold"))
        for quantity in validation.quantities:
            console.print(_definition(quantity))
    if comparison is not None:
        console.print()
        console.print(_comparison(comparison, other))
    console.print(standing(calibration))
    print_findings(console, findings, "info")


def print_point_sightings(console: Console, points: PointSightings) -> None:
    """What is in a table of points whose place or pose is known."""
    table = NumberTable(f"{points.source}: points whose place is known", "points", "images", first="target")
    for target in dict.fromkeys(points.target.tolist()):
        here = points.target == target
        table.add_row(target or "(none)", str(int(here.sum())), str(len(set(points.frame[here].tolist()))))
    console.print(table)
    known = {"places": points.points_mm, "poses of the probe": points.tracker_from_probe}
    console.print("With " + " and ".join(name for name, given in known.items() if given is not None) + ".")


def _numbers(validation: Validation) -> NumberTable:
    table = NumberTable(f"Errors on {validation.source}, mm", "value", "95 % interval", "spread", "from")
    for q in validation.quantities:
        interval = "unknown" if math.isnan(q.low_mm) else f"{q.low_mm:.2f} to {q.high_mm:.2f}"
        table.add_row(
            q.title, f"{q.value_mm:.3f}", interval, f"{q.spread_mm:.2f}", f"{q.count} in {q.units} {q.unit}"
        )
    return table


def _definition(quantity: Quantity) -> RenderableType:
    return Padding(Text(f"{quantity.title}: {quantity.definition}."), (0, 0, 0, 2), expand=False)


def _comparison(comparison: Comparison, other: str) -> RenderableType:
    table = NumberTable(f"Against {other}, mm", "apart", "uncertainty allows (95 %)")
    for place, distance, allowed in comparison.rows:
        table.add_row(f"at {place} px", f"{distance:.2f}", f"{allowed:.2f}")
    shared = (
        " Both were fitted to the same rows: their errors go together." if comparison.shared_input else ""
    )
    return Group(table, Text(comparison.sentence + shared))
