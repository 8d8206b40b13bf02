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
from sonocal.observations import Observations
from sonocal.validation import Quantity

__all__ = ["misread", "misread_finding"]


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


def _rms_mm(existing: Existing, rows: Observations) -> float:
    return float(np.sqrt(np.mean(line_distances(existing.probe_from_image, rows) ** 2)))
