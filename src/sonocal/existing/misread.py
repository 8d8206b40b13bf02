"""A matrix that a scan shows to be right when it is read otherwise: which way, and how far off it is so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sonocal.calibration import Calibration, line_distances
from sonocal.existing.fitting import Rereading, fitting, in_words
from sonocal.existing.matrix import Existing
from sonocal.existing.rereadings import rereadings
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.validation import PointSightings, Quantity

__all__ = ["misread", "misread_finding", "misread_on_points"]

# Known places and the points of images are right to so much, mm (twice that is near, six times as much far off), or to
# a share of how far apart the places are; fewer points are met by chance.
KNOWN_MM, KNOWN_SHARE, FEWEST = 2.5, 0.05, 4


def misread(
    existing: Existing,
    rows: Observations,
    own: Calibration,
    ours: Sequence[Quantity],
) -> list[Rereading]:
    """What a matrix may be instead, by one usual mistake: of several, the rows do not tell which.

    Args:
        existing: the matrix.
        rows: that both were measured on.
        own: our calibration of them.
        ours: what was measured of our calibration, its error on the rows first.
    """
    if not ours:
        return []
    scale = float(own.probe_from_image.scales[:2].mean())
    ways = rereadings(existing, rows.dimension, rows.image_size_px, scale)
    return fitting(
        ways,
        lambda matrix: _rms_mm(replace(existing, matrix=matrix), rows),
        _rms_mm(existing, rows),
        ours[0].value_mm,
    )


def misread_finding(
    existing: Existing, rows: Observations, found: Sequence[Rereading], ours: Quantity
) -> Diagnostic:
    """What it is, how far off as it was read and read so, and what to do."""
    words, advice = in_words(found)
    as_read = _rms_mm(existing, rows)
    so = max(_rms_mm(one.of(existing), rows) for one in found)
    return Diagnostic(
        code="misread-matrix",
        severity="warning",
        message=(
            f"{existing.said} {words}: as it was read it is off by {as_read:.2f} mm on these rows, read so by "
            f"{so:.2f} mm, and our own calibration by {ours.value_mm:.2f} mm"
        ),
        advice=advice,
    )


def misread_on_points(
    existing: Existing, sightings: PointSightings
) -> tuple[list[Rereading], Diagnostic | None]:
    """What a matrix may be instead, by points whose places are known: the ways that meet them, and the finding."""
    if sightings.points_mm is None or len(sightings) < FEWEST:
        return [], None
    places = sightings.points_probe_mm
    extent = float(np.linalg.norm(np.ptp(places, axis=0)))

    def off(matrix: Array) -> float:
        apart = sightings.points_px @ matrix[:3, : sightings.points_px.shape[1]].T + matrix[:3, 3] - places
        return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))

    ways = rereadings(existing, sightings.points_px.shape[1])
    found = fitting(ways, off, off(existing.matrix), min(KNOWN_MM, KNOWN_SHARE * extent))
    if not found:
        return [], None
    words, advice = in_words(found, "these points do")
    message = (
        f"{existing.said} {words}: as it was read it is off by {off(existing.matrix):.2f} mm on these points, read so "
        f"by {max(off(one.matrix) for one in found):.2f} mm"
    )
    return found, Diagnostic(code="misread-matrix", severity="warning", message=message, advice=advice)


def _rms_mm(existing: Existing, rows: Observations) -> float:
    return float(np.sqrt(np.mean(line_distances(existing.probe_from_image, rows) ** 2)))
