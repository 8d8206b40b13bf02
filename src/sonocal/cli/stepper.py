"""The part of ``sonocal tool`` that finds the axes of a stepper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.options import console, typed
from sonocal.cli.screen.plain import say_json
from sonocal.cli.told import refuse_units, unit_doubts

if TYPE_CHECKING:
    from sonocal.recording import Recording

__all__ = ["find_stepper"]

NOT_OF_STEPPERS = (
    *("spin", "second", "spin_frames", "second_frames", "length_mm", "stylus", "stylus_tip", "expected"),
    *("output", "name", "landmarks"),
)


def find_stepper(
    rotation: Recording, translation: Recording, tool: str, options: dict[str, Any], *, as_json: bool
) -> None:
    """Find a stepper's axes and show them.

    Args:
        rotation: the stepper turning the probe alone.
        translation: it moving the probe along alone.
        tool: the probe's marker.
        options: of the command.
        as_json: print for programs.
    """
    from sonocal.cli.screen.parts import print_findings
    from sonocal.tools import calibrate_stepper

    if names := typed(NOT_OF_STEPPERS):
        raise click.UsageError(
            f"{names[0]} means nothing with --stepper, which finds two axes; leave one out"
        )
    for one in (rotation, translation):
        refuse_units(one.name, unit_doubts(one), accepted=options["accept_units"])
    frame = options["reference"] or "Tracker"
    turned, moved = (one.between(frame, tool, None, options["on_invalid"]) for one in (rotation, translation))
    found = calibrate_stepper(
        turned.matrices,
        moved.matrices,
        rotation_valid=turned.valid,
        translation_valid=moved.valid,
        source=rotation.name,
    )
    if as_json:
        say_json(found)
        return
    screen = console()
    print_findings(screen, found.diagnostics, "warning")
    axis, centre, along = (
        ", ".join(f"{x:.{digits}f}" for x in vector)
        for vector, digits in ((found.axis, 4), (found.centre_mm, 2), (found.translation, 4))
    )
    for line in (
        f"Axis of rotation: along ({axis}) through ({centre}) mm of {tool}, which wobbles by {found.wobble_deg:.2f} "
        f"deg and {found.wobble_mm:.2f} mm rms; turned by {found.turn_deg:.0f} deg rms.",
        f"Axis of translation: along ({along}), {found.off_mm:.2f} mm rms beside it over {found.travel_mm:.0f} mm.",
        f"They are {found.between_deg:.2f} deg apart (+-{1.96 * found.between_sigma_deg:.2f}, 95 %).",
        f"No sweep of this stepper tells, of targets without a place, {' and '.join(found.free_motions)}.",
    ):
        screen.print(line, markup=False)
    print_findings(screen, found.diagnostics, "info")
