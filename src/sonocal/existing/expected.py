"""A matrix of other software against a calibration of ours: read otherwise, or of other mm/px, where that differs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sonocal.calibration import Calibration
from sonocal.calibration.models import scale_known
from sonocal.existing.difference import known_mm
from sonocal.existing.fitting import Rereading, fitting, in_words
from sonocal.existing.matrix import Existing
from sonocal.existing.rereadings import rereadings
from sonocal.findings import Diagnostic, warnings_first
from sonocal.geometry import Array, area_places, homogeneous_points

__all__ = ["against_expected", "agreeing", "expected_findings", "misread_against"]

# What is expected is roughly right: so near, mm over the image (twice that is near, six times as much far off), and of
# images below 50 mm so near as a share of the diagonal.
ROUGH_MM, ROUGH_SHARE = 2.5, 0.05
# Of mm/px, as a share: another depth setting, and no other calibration of the same.
UNEQUAL = 0.05
BY_ORIENTATION = {"flipped-image", "unexpected-orientation"}


def against_expected(calibration: Calibration, expected: Existing | Calibration) -> Calibration:
    """The calibration with what is found of the one expected, as `expected_findings` has it.

    Args:
        calibration: ours, calibrated with the other's rotation as `expected_rotation`.
        expected: a calibration that is turned roughly as it must be.
    """
    found = expected_findings(calibration.diagnostics, calibration, expected)
    return replace(calibration, diagnostics=found)


def expected_findings(
    found: Sequence[Diagnostic],
    calibration: Calibration,
    expected: Existing | Calibration,
    *,
    scale: bool = True,
) -> tuple[Diagnostic, ...]:
    """Findings, with what is found of the calibration expected: where that was misread, no image is called flipped.

    Args:
        found: what is known of the calibration, or what rows say against it.
        calibration: ours.
        expected: the other one, whose rotation was taken for the expected one.
        scale: other mm/px are a finding, too.
    """
    ways = agreeing(expected, calibration) if isinstance(expected, Existing) else []
    if not ways or not isinstance(expected, Existing):
        return warnings_first([*found, *(_scale(calibration, expected) if scale else ())])
    # Of images that run otherwise it may as well be ours that were recorded so.
    explained = set() if any(one.of_images for one in ways) else BY_ORIENTATION
    kept = [one for one in found if one.code not in explained]
    return warnings_first([*kept, misread_against(expected, ways, calibration)])


def agreeing(existing: Existing, calibration: Calibration) -> list[Rereading]:
    """How a matrix agrees with a calibration when it is read otherwise, where it is far from it as it was read.

    It agrees within 5 mm, rms over the image's corners and centre (a tenth of the diagonal of images below 50 mm), or
    within twice what the calibration is known to, where that is more; beyond three times that it is far. Of several
    ways this does not tell which is right.
    """
    ways = rereadings(
        existing,
        calibration.dimension,
        calibration.image_size_px,
        float(calibration.probe_from_image.scales[:2].mean()),
    )
    return fitting(
        ways,
        lambda matrix: _apart_mm(matrix, calibration),
        _apart_mm(existing.matrix, calibration),
        _open_mm(calibration),
    )


def misread_against(
    existing: Existing, ways: Sequence[Rereading], calibration: Calibration, name: str = "this calibration"
) -> Diagnostic:
    """What a matrix is, how far from a calibration as it was read and read so, and what to do.

    Args:
        existing: the matrix.
        ways: by which it agrees.
        calibration: what it agrees with.
        name: of the calibration, in the message.
    """
    words, advice = in_words(ways, "their agreement does")
    so = max(_apart_mm(one.matrix, calibration) for one in ways)
    tail = (
        "; whose images are the right way round, no residual tells"
        if any(one.of_images for one in ways)
        else ", and the image is the right way round"
    )
    return Diagnostic(
        code="misread-matrix",
        severity="info",
        message=(
            f"{existing.said} {words}: as it was read it is {_apart_mm(existing.matrix, calibration):.2f} mm from "
            f"{name}, read so {so:.2f} mm{tail}"
        ),
        advice=advice,
    )


def _apart_mm(matrix: Array, calibration: Calibration) -> float:
    """How far apart the two put the image's corners and centre, rms."""
    places = homogeneous_points(area_places(calibration.area_px))
    apart = (matrix - calibration.probe_from_image.matrix)[:3]
    difference = places @ apart[:, :3].T + apart[:, 3]
    return float(np.sqrt(np.mean(np.sum(difference**2, axis=1))))


def _open_mm(calibration: Calibration) -> float:
    """What two calibrations of one probe may differ by, where both are as they mostly are."""
    places = area_places(calibration.area_px)
    diagonal = np.ptp(places, axis=0) * calibration.probe_from_image.scales[: calibration.dimension]
    rough = min(ROUGH_MM, ROUGH_SHARE * float(np.linalg.norm(diagonal)))
    known = known_mm(calibration, places)
    return rough if known is None else max(rough, float(np.sqrt(np.mean(known**2))))


def _scale(calibration: Calibration, expected: Existing | Calibration) -> Iterator[Diagnostic]:
    theirs, ours = (one.probe_from_image.scales[: calibration.dimension] for one in (expected, calibration))
    ratios = theirs / ours - 1.0
    axis = int(np.argmax(np.abs(ratios)))
    if abs(ratios[axis]) > UNEQUAL + scale_known(calibration):
        yield Diagnostic(
            code="expected-scale-differs",
            severity="info",
            message=(
                f"the expected calibration has {theirs[axis]:.5g} mm/px and this one {ours[axis]:.5g}, "
                f"{100 * ratios[axis]:+.1f} %; its orientation alone was compared"
            ),
            advice="mind which depth setting each is for, and that the expected one is from px to mm",
        )
