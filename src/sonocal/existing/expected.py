"""A calibration against the one that was expected: read otherwise, or of other mm/px, where that is what differs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sonocal.calibration import Calibration
from sonocal.existing.matrix import Existing
from sonocal.existing.rereadings import Rereading, fitting, in_words, rereadings
from sonocal.findings import Diagnostic, warnings_first
from sonocal.geometry import Array, area_places, homogeneous_points

__all__ = ["against_expected"]

# What is expected is roughly right: so near, mm over the image (twice that is near, six times as much far off).
ROUGH_MM = 2.5
# Of mm/px, as a share: another depth setting, and no other calibration of the same.
UNEQUAL = 0.05
BY_ORIENTATION = {"flipped-image", "unexpected-orientation"}


def against_expected(calibration: Calibration, expected: Existing | Calibration) -> Calibration:
    """The calibration with what is found of the one expected: where that was misread, no image is called flipped."""
    found = [*calibration.diagnostics]
    ways = _misread(calibration, expected) if isinstance(expected, Existing) else []
    if ways and isinstance(expected, Existing):
        found = [one for one in found if one.code not in BY_ORIENTATION]
        found.append(_told(calibration, expected, ways))
    else:
        found += _scale(calibration, expected)
    return replace(calibration, diagnostics=warnings_first(found))


def _misread(calibration: Calibration, expected: Existing) -> list[Rereading]:
    scale = float(calibration.probe_from_image.scales[:2].mean())
    # Not those of images that run otherwise: they are what is looked for.
    ways = rereadings(expected, calibration.dimension, scale_mm_per_px=scale, images=False)
    return fitting(
        ways, lambda matrix: _apart_mm(calibration, matrix), _apart_mm(calibration, expected.matrix), ROUGH_MM
    )


def _apart_mm(calibration: Calibration, matrix: Array) -> float:
    """How far apart the two put the image's corners and centre, rms."""
    places = homogeneous_points(area_places(calibration.area_px))
    apart = (matrix - calibration.probe_from_image.matrix)[:3]
    difference = places @ apart[:, :3].T + apart[:, 3]
    return float(np.sqrt(np.mean(np.sum(difference**2, axis=1))))


def _told(calibration: Calibration, expected: Existing, ways: list[Rereading]) -> Diagnostic:
    words, advice = in_words(ways)
    as_read, so = (_apart_mm(calibration, matrix) for matrix in (expected.matrix, ways[0].matrix))
    return Diagnostic(
        code="misread-matrix",
        severity="info",
        message=(
            f"what was expected, {expected.said}, {words}: as it was read it is {as_read:.2f} mm from this "
            f"calibration, read so {so:.2f} mm, and the image is the right way round"
        ),
        advice=advice,
    )


def _scale(calibration: Calibration, expected: Existing | Calibration) -> Iterator[Diagnostic]:
    theirs, ours = (one.probe_from_image.scales[: calibration.dimension] for one in (expected, calibration))
    ratios = theirs / ours - 1.0
    axis = int(np.argmax(np.abs(ratios)))
    if abs(ratios[axis]) > UNEQUAL:
        yield Diagnostic(
            code="expected-scale-differs",
            severity="info",
            message=(
                f"the expected calibration has {theirs[axis]:.5g} mm/px and this one {ours[axis]:.5g}, "
                f"{100 * ratios[axis]:+.1f} %; its orientation alone was compared"
            ),
            advice="mind which depth setting each is for, and that the expected one is from px to mm",
        )
