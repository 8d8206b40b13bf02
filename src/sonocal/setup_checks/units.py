"""Are the table's lengths mm, and its places px?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.axis_units import axis_doubt, end_doubt
from sonocal.geometry.units import GO_ON, length_hints, scale_hints, scan_hints, unit_doubt
from sonocal.observations import Observations
from sonocal.observations.spanning import lengths_of
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows
from sonocal.setup_checks.evidence import Evidence

__all__ = ["check_units", "units_as_they_stand"]


def check_units(evidence: Evidence) -> Iterator[Diagnostic]:
    """Does the scale exist, and do segments, area and marker have a size that set-ups have?"""
    rows, transform = evidence.observations, evidence.transform
    hints = scale_hints(
        transform.scales[: max(evidence.parameters - 6, 1)], _deviation(evidence), rows.dimension
    )
    lengths = lengths_of(rows.spans, rows.segments_mm)
    hints += length_hints(rows.points_px, lengths)
    if not hints and len(rows):
        middle = rows.points_px.mean(axis=0, keepdims=True)
        hints = scan_hints(
            image_mm=float((np.ptp(evidence.seen_px, axis=0) * transform.scales[: rows.dimension]).max()),
            needle_mm=float(np.median(lengths)) if len(lengths) else np.nan,
            marker_mm=float(np.linalg.norm(transform @ middle)),
            scale=float(transform.scales[: rows.dimension].max()),
            rms_mm=evidence.rms_mm,
            dimension=rows.dimension,
        )
    yield from unit_doubt(hints) if hints else axis_doubt(_of_one_target(evidence.table))


def units_as_they_stand(rows: Observations, table: PointLineRows | TargetRows) -> Iterator[Diagnostic]:
    """What a table's numbers alone say of their units, where there is no calibration of them."""
    hints = length_hints(rows.points_px, lengths_of(rows.spans, rows.segments_mm))
    segments = _of_one_target(table)
    for one in unit_doubt(hints) if hints else (*axis_doubt(segments), *end_doubt(segments)):
        yield replace(one, advice=one.advice.removesuffix(GO_ON))  # what was refused does not go on


def _of_one_target(table: PointLineRows | TargetRows) -> Array:
    """(M, 2, 3): the segments of the line that has most rows; none where there is no line."""
    line = table.spans == 2
    target = table.target
    assert target is not None
    if not line.any():
        return np.zeros((0, 2, 3))
    most = np.argmax(np.bincount(target[line]))
    return np.asarray(table.spanning_mm[line & (target == most), :2])


def _deviation(evidence: Evidence) -> float:
    """Of the logarithm of the scale that is known least; 0 of one that was told."""
    if evidence.covariance is None:
        return 0.0
    return float(np.sqrt(np.diag(evidence.covariance)[6:].max(initial=0.0)))
