"""Are the table's lengths mm, and its places px?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.axis_units import axis_doubt
from sonocal.geometry.units import length_hints, scale_hints, scan_hints, unit_doubt
from sonocal.setup_checks.evidence import Evidence

__all__ = ["check_units"]


def check_units(evidence: Evidence) -> Iterator[Diagnostic]:
    """Does the scale exist, and do segments, area and marker have a size that set-ups have?"""
    rows, transform = evidence.observations, evidence.transform
    hints = scale_hints(
        transform.scales[: max(evidence.parameters - 6, 1)], _deviation(evidence), rows.dimension
    )
    hints += length_hints(rows.points_px, rows.segments_mm)
    if not hints and len(rows):
        middle = rows.points_px.mean(axis=0, keepdims=True)
        hints = scan_hints(
            image_mm=float((np.ptp(evidence.seen_px, axis=0) * transform.scales[: rows.dimension]).max()),
            needle_mm=float(np.median(evidence.mapped.lengths_mm)),
            marker_mm=float(np.linalg.norm(transform @ middle)),
            scale=float(transform.scales[: rows.dimension].max()),
            rms_mm=evidence.rms_mm,
            dimension=rows.dimension,
        )
    yield from unit_doubt(hints) if hints else axis_doubt(_of_one_target(evidence))


def _of_one_target(evidence: Evidence) -> Array:
    """(M, 2, 3): the segments of the target that has most rows."""
    target = evidence.table.target
    assert target is not None
    return np.asarray(evidence.table.segments_mm[target == np.argmax(np.bincount(target))])


def _deviation(evidence: Evidence) -> float:
    """Of the logarithm of the scale that is known least; 0 of one that was told."""
    if evidence.covariance is None:
        return 0.0
    return float(np.sqrt(np.diag(evidence.covariance)[6:].max(initial=0.0)))
