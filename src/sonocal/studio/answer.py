"""A calibration in the numbers and words that the page draws."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sonocal.calibration import Calibration, line_distances, seen_at_assumed_speed
from sonocal.calibration.diagnostics import describe_motion
from sonocal.calibration.lagged import lag_in_words
from sonocal.calibration.models import scale_in_words
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, area_places, homogeneous_points, needle_in_image, segment_directions
from sonocal.observations import Observations
from sonocal.registration.uncertainty import radius_95, weakest_motion
from sonocal.validation import cannot_show, give_verdict
from sonocal.validation.coverage import coverage_of

__all__ = ["answer_of", "crossings", "numbers"]

GRID = 21
MOST_NEEDLES = 150
DIGITS = 3
OUTSIDE_PX = 50.0
"""As far beyond the area a cross is still worth to be known."""


def answer_of(found: Calibration, rows: Observations, of_images: Sequence[Diagnostic] = ()) -> dict[str, Any]:
    """What the page shows of a calibration.

    Args:
        found: the calibration.
        rows: that it was fitted to.
        of_images: what was seen in the images, which a fit of points alone does not know.
    """
    known = {one.code for one in found.diagnostics}
    found = found.with_findings([one for one in of_images if one.code not in known])
    verdict = give_verdict(found)
    lined = rows.lines_only
    return {
        "verdict": {
            "level": verdict.level,
            "headline": verdict.headline,
            "expectation": verdict.expectation,
            "reasons": [*map(list, zip(verdict.codes, verdict.reasons, strict=True))],
        },
        "fit": {
            "rms_mm": found.fit.rms_mm,
            "median_mm": found.fit.median_mm,
            "p95_mm": found.fit.p95_mm,
            "max_mm": found.fit.max_mm,
            "used": found.fit.inliers,
            "of": found.fit.observations,
            "threshold_mm": found.threshold_mm,
        },
        "predicted": _predicted(found),
        "findings": [_finding(one) for one in found.diagnostics],
        "cannot_show": list(cannot_show(found)),
        "words": [scale_in_words(found), *filter(None, [lag_in_words(found)])],
        "matrix": found.probe_from_image.matrix.tolist(),
        "loosest": _loosest(found),
        "residuals": _residuals(found, rows) if lined else [],
        "scene": _scene(found, rows if lined else None),
        "coverage": coverage_of(found, rows) if lined else None,
    }


def numbers(values: Array, digits: int = DIGITS) -> Any:
    """Numbers for JSON, which knows no NaN: rounded, None where there is none."""
    rounded = np.round(np.asarray(values, dtype=float), digits)
    if np.isfinite(rounded).all():
        return rounded.tolist()
    some = rounded.astype(object)
    some[~np.isfinite(rounded)] = None
    return some.tolist()


def _predicted(found: Calibration) -> dict[str, Any] | None:
    """The error that 95 % stay below: over a grid of the area, at its corners and its centre."""
    if found.covariance is None:
        return None
    low, high = found.area_px
    u, v = (np.linspace(low[i], high[i], GRID) for i in (0, 1))
    places = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    if found.dimension == 3:
        places = np.column_stack([places, np.full(len(places), (low[2] + high[2]) / 2)])
    below = radius_95(found.predict(places)[1], found.noise.freedom)
    corners = found.predicted_errors()[2]
    return {
        "worst_mm": float(corners[:-1].max()),
        "centre_mm": float(corners[-1]),
        "tolerance_mm": found.options.tolerance_mm,
        "area": found.area_name,
        "grid": GRID,
        "low_px": low.tolist(),
        "high_px": high.tolist(),
        "below_mm": numbers(below),
    }


def _finding(one: Diagnostic) -> dict[str, str]:
    return {"code": one.code, "severity": one.severity, "message": one.message, "advice": one.advice}


def _loosest(found: Calibration) -> str:
    if found.covariance is None:
        return ""
    motion = weakest_motion(found.probe_from_image, found.covariance, area_places(found.area_px)[:-1])
    return describe_motion(motion, found.noise.freedom)


def _residuals(found: Calibration, rows: Observations) -> list[list[Any]]:
    """Of each row: frame, target, distance to its line in mm, and whether that is within the threshold."""
    distances = line_distances(found.probe_from_image, seen_at_assumed_speed(found.sound, rows))
    agree = distances <= found.threshold_mm
    columns = (rows.frame.tolist(), rows.target.tolist(), numbers(distances), agree.tolist())
    return [list(row) for row in zip(*columns, strict=True)]


def _scene(found: Calibration, rows: Observations | None) -> dict[str, Any]:
    """The image's corners and the needles through it, mm in the probe marker's frame."""
    low, high = found.area_px[:, :2]
    depth = [] if found.dimension == 2 else [found.area_px[:, 2].mean()]
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    edge = found.probe_from_image @ np.array([[*corner, *depth] for corner in corners])
    scene: dict[str, Any] = {"corners_mm": numbers(edge, 2), "needles_mm": [], "frames": []}
    if rows is None or not len(rows):
        return scene
    index = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), MOST_NEEDLES)).astype(int))
    some = rows.select(index)
    directions = segment_directions(some.segments_mm)
    mapped = found.probe_from_image @ homogeneous_points(some.points_px)
    along = np.sum((mapped - some.segments_mm[:, 0]) * directions, axis=1, keepdims=True)
    feet = some.segments_mm[:, 0] + along * directions
    reach = 0.35 * float(np.ptp(edge, axis=0).max())
    pieces = np.stack([feet - reach * directions, feet + reach * directions], axis=1)
    return scene | {"needles_mm": numbers(pieces, 2), "frames": some.frame.tolist()}


def crossings(found: Calibration, segments_mm: Array) -> Any:
    """Where a calibration says that lines (N, L, 2, 3) are in images of a 2D probe: (N, L, 2) px, None outside."""
    flat = segments_mm.reshape(-1, 2, 3)
    met = np.full((len(flat), 2), np.nan)
    posed = np.isfinite(flat).all(axis=(1, 2))
    if posed.any():
        met[posed] = needle_in_image(found.probe_from_image, flat[posed])
        if found.sound is not None:  # the images are as scanned
            met[posed] = found.sound.in_image(met[posed])
    low, high = found.area_px
    with np.errstate(invalid="ignore"):
        met[~((met >= low - OUTSIDE_PX) & (met <= high + OUTSIDE_PX)).all(axis=1)] = np.nan
    return numbers(met.reshape(*segments_mm.shape[:2], 2), 2)
