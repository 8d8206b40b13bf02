"""What the command line shows of a phantom that was put in place by its landmarks."""

from __future__ import annotations

import numpy as np
from rich.console import Console
from rich.text import Text

from sonocal.cli.screen.parts import print_findings
from sonocal.cli.screen.tables import NumberTable
from sonocal.tools import PhantomRegistration

__all__ = ["print_phantom"]

# Of wires: those that the registration moves most.
MOST_TARGETS = 5


def print_phantom(console: Console, found: PhantomRegistration) -> None:
    """Warnings first, what is known of the phantom's place, then its landmarks and wires, then the notes."""
    print_findings(console, found.diagnostics, "warning")
    console.print(_known(found))
    console.print()
    if found.landmarks:
        console.print(_landmarks(found))
    if found.features:
        console.print(_features(found))
    if found.target_errors:
        console.print(_targets(found))
    print_findings(console, found.diagnostics, "info")


def _known(found: PhantomRegistration) -> Text:
    worst = found.worst
    order = "in the order listed" if found.as_listed else "in an order of their own"
    touched = f"{sum(one.used for one in found.landmarks)} of {len(found.landmarks)} landmarks"
    along = f"{sum(one.used for one in found.features)} of {len(found.features)} lines and planes"
    by = [touched] * bool(found.landmarks) + [along] * bool(found.features)
    scale = (
        f" Scale of the phantom: {found.size_ratio:.4f} +-{1.96 * found.size_ratio_deviation:.4f}."
        if np.isfinite(found.size_ratio_deviation)
        else " What was touched tells no scale of the phantom."
    )
    places = (
        f"; its wires are known to {found.target_errors[0].within_95_mm:.2f} mm (95 %)"
        if found.target_errors
        else ""
    )
    return Text(
        f"{found.phantom}To{found.reference}: {', '.join(by)}, touched {order}, "
        f"{found.rms_mm:.2f} mm rms from their places{places}. Worst: {worst.name}, {worst.distance_mm:.2f} mm.{scale}"
    )


def _landmarks(found: PhantomRegistration) -> NumberTable:
    table = NumberTable("Landmarks", "items", "off by, mm", "", first="name")
    for one in found.landmarks:
        items = ", ".join(f"{first}-{last}" for first, last in one.frames)
        off = "" if one.distance_mm is None else f"{one.distance_mm:.2f}"
        state = "used" if one.used else ("not touched" if one.distance_mm is None else "left out")
        table.add_row(one.name, items, off, state)
    return table


def _features(found: PhantomRegistration) -> NumberTable:
    table = NumberTable("Lines and planes", "items", "off by, mm", "noise, mm", "", first="name")
    for one in found.features:
        items = ", ".join(f"{first}-{last}" for first, last in one.frames)
        off, spread = ("" if x is None else f"{x:.2f}" for x in (one.distance_mm, one.spread_mm))
        state = "used" if one.used else ("not dragged along" if one.distance_mm is None else "left out")
        table.add_row(one.name, items, off, spread, state)
    return table


def _targets(found: PhantomRegistration) -> NumberTable:
    table = NumberTable("What the registration moves wires by, worst first", "95 % within, mm", first="name")
    for one in found.target_errors[:MOST_TARGETS]:
        table.add_row(one.name, f"{one.within_95_mm:.2f}")
    return table
