"""The numbers that `sonocal validate` gives of a calibration of ours: made, told, and for programs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from sonocal.cli.measured import Measured
from sonocal.cli.options import console
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.validation import Comparison, Validation

__all__ = ["numbers_of", "numbers_record", "print_numbers", "with_comparison"]


def with_comparison(numbers: Validation, found: Calibration, comparison: Comparison) -> Validation:
    """The numbers with what the comparison finds."""
    from sonocal.validation.measured import comparison_findings

    return replace(numbers, diagnostics=(*numbers.diagnostics, *comparison_findings(found, comparison)))


def numbers_of(calibration: Calibration, measured: Measured, options: dict[str, Any]) -> Validation:
    """The numbers of a table of sightings, or of points."""
    from sonocal.validation import validate, validate_points

    if measured.points is not None:
        return validate_points(calibration, measured.points)
    return validate(calibration, measured.sightings, nwires=measured.nwires, **options)


def print_numbers(
    calibration: Calibration, numbers: Validation, comparison: Comparison | None, other: str
) -> None:
    """Say them.

    Raises:
        InputError: there is none.
    """
    from sonocal.cli.screen.validation import print_validation

    if not numbers.quantities and not numbers.diagnostics:
        raise InputError(f"{numbers.source}: gives no number; it needs held-out rows, places or poses")
    print_validation(console(), calibration, numbers, comparison, other)


def numbers_record(
    calibration: Calibration, numbers: Validation, comparison: Comparison | None
) -> dict[str, Any]:
    """They as `--json` prints them."""
    from sonocal.validation import cannot_show, give_verdict

    record: dict[str, Any] = {
        "verdict": give_verdict(calibration, numbers),
        "input": numbers.source,
        "sha256": numbers.sha256,
        "quantities": numbers.quantities,
        "diagnostics": numbers.diagnostics,
        "cannot_show": cannot_show(calibration),
    }
    if comparison is not None:
        record["comparison"] = {
            "places_px": comparison.places_px.tolist(),
            "distance_mm": comparison.distance_mm.tolist(),
            "allowed_mm": comparison.allowed_mm.tolist(),
            "p_value": comparison.p_value,
            "shared_input": comparison.shared_input,
        }
    return record
