"""Calibrations beside the one that ``validate`` judges, ours or of other software: --compare and --expected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from sonocal.cli.options import console

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.existing import Existing
    from sonocal.existing.compared import Compared
    from sonocal.existing.difference import Difference
    from sonocal.existing.fitting import Rereading
    from sonocal.validation import Validation

__all__ = [
    "Others",
    "apart_record",
    "called",
    "misread_records",
    "print_apart",
    "reread_records",
    "with_others",
]


@dataclass(frozen=True)
class Others:
    """What a calibration of ours is held against.

    Attributes:
        compared: what --compare names.
        expected: what --expected names.
    """

    compared: Calibration | Existing | None
    expected: Calibration | Existing | None

    @property
    def expectation(self) -> Calibration | Existing | None:
        """The one that tells how the image must be turned."""
        return self.expected or self.compared


def with_others(
    numbers: Validation, found: Calibration, others: Others
) -> tuple[Validation, Compared | None, list[dict[str, Any]]]:
    """What rows say of a calibration of ours, with what matrices of other software beside it say.

    Returns:
        The numbers with these findings, how far the matrix of --compare is, and which were misread, for programs.
    """
    from sonocal.existing import Existing
    from sonocal.existing.compared import compared
    from sonocal.existing.expected import expected_findings, misread_against

    findings, beside, records = numbers.diagnostics, None, []
    if (expectation := others.expectation) is not None:
        scale = others.expected is not None
        findings = expected_findings(findings, found, expectation, scale=scale)
    if isinstance(others.compared, Existing):
        beside = compared(others.compared, found)
        records = reread_records(others.compared, beside.rereadings)
        if beside.rereadings and others.expected is not None:
            findings = (*findings, misread_against(others.compared, beside.rereadings, found))
    records += misread_records(others.expected, found)
    return replace(numbers, diagnostics=findings), beside, records


def misread_records(expected: Calibration | Existing | None, found: Calibration) -> list[dict[str, Any]]:
    """How what --expected names is right, where it was misread, for programs."""
    from sonocal.existing import Existing
    from sonocal.existing.expected import agreeing

    return reread_records(expected, agreeing(expected, found)) if isinstance(expected, Existing) else []


def called(other: Calibration | Existing | None, name: str) -> str:
    """What another calibration is called: the matrix and its file, or the file."""
    from sonocal.existing import Existing

    return f"the other calibration, {other.said if isinstance(other, Existing) else name}"


def print_apart(apart: Difference, title: str) -> None:
    """Show how far a matrix of other software is from a calibration of ours."""
    from sonocal.cli.screen.existing import print_difference

    print_difference(console(), apart, title)


def reread_records(
    existing: Calibration | Existing | None, ways: Sequence[Rereading]
) -> list[dict[str, Any]]:
    """How a matrix that was misread is right, for programs: none, one, or several that fit alike."""
    from sonocal.existing import Existing

    if not isinstance(existing, Existing):
        return []
    return [
        {
            "file": existing.file,
            "transform": existing.transform,
            "name": one.name,
            "message": f"{existing.said} {one.words}",
            "advice": one.advice,
            "probe_from_image": one.matrix,
        }
        for one in ways
    ]


def apart_record(apart: Difference) -> dict[str, Any]:
    """The same for programs."""
    return {
        "places_px": apart.places_px,
        "difference_mm": apart.difference_mm,
        "distance_mm": apart.distance_mm,
        "known_mm": apart.known_mm,
        "rotation_deg": apart.rotation_deg,
        "scales_mm_per_px": apart.scales_mm_per_px,
        "other_scales_mm_per_px": apart.other_scales_mm_per_px,
        "sentence": apart.sentence,
    } | ({} if apart.reread is None else {"reread": apart_record(apart.reread)})
