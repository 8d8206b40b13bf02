"""Rows of one needle that were left out and agree among themselves: the needle was seen twice."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.registration.copies import common_shift, lies_one_way, parted
from sonocal.registration.mapped import MappedRows
from sonocal.registration.uncertainty import point_jacobian
from sonocal.setup_checks.evidence import Evidence
from sonocal.setup_checks.threshold import cut_deviation

__all__ = ["check_copies"]

LEAST_ROWS, LEAST_SHARE = 6, 0.05
FARTHEST_MM = 40.0
# Standard deviations of a row's residual within which a shift explains it, and the least that is looked at.
WITHIN, LEAST_MM = 2.5, 1.0
# Of the changes between used and left out, in the order of time, that chance would make: a slip has one.
MIXED = 0.4
SIDEWAYS = 0.5
# Fewer sightings part in two by chance (6 of 100 scans of 20); more rows than the most tell no more.
FEWEST_PARTED, MOST_ROWS = 40, 2000


def check_copies(evidence: Evidence) -> Iterator[Diagnostic]:
    """Does one shift in the image part the rows in two, as with a reverberation or a second needle?

    Either it explains rows that were left out, or it parts those that were used, which lie to either side of the
    answer. Only of a table of one needle: a row of one of several wires may be another one's.
    """
    table = evidence.table
    assert table.target is not None
    if not isinstance(evidence.mapped, MappedRows) or len(np.unique(table.target)) > 1:
        return
    yield from _among_left_out(evidence, evidence.mapped.directions) or _among_used(evidence)


def _among_left_out(evidence: Evidence, directions: Array) -> tuple[Diagnostic, ...]:
    left = np.flatnonzero(~evidence.inlier & (evidence.mapped.distances <= FARTHEST_MM))
    # A fit of what a threshold cuts out of wider noise may be off towards any side, and leave more on the other.
    if len(left) < LEAST_ROWS or cut_deviation(evidence) is not None:
        return ()
    groups = _sightings(evidence)[left]
    within_mm = max(WITHIN * evidence.rms_mm, LEAST_MM)
    displaced, by_shift = evidence.mapped.residuals[left], _by_shift(evidence, left)
    found = common_shift(displaced, by_shift, groups, within_mm=within_mm, among=len(np.unique(groups)))
    if found is None or not lies_one_way(
        found, displaced, by_shift, groups, directions[left], within_mm=within_mm
    ):
        return ()
    rows = left[found.explained]
    used = np.flatnonzero(evidence.inlier)
    if len(rows) < LEAST_SHARE * len(evidence.table) or not _mixed(evidence, rows, used):
        return ()
    return (
        _second(
            found.shift, f"{len(rows)} of the {len(left)} rows that were left out", len(used), "were used"
        ),
    )


def _among_used(evidence: Evidence) -> tuple[Diagnostic, ...]:
    used = np.flatnonzero(evidence.inlier)
    used = used[:: 1 + len(used) // MOST_ROWS] if evidence.table.dimension == 2 else used[:MOST_ROWS]
    if len(np.unique(_sightings(evidence)[used])) < FEWEST_PARTED:
        return ()
    found = parted(
        evidence.mapped.residuals[used],
        _motions(evidence, used),
        _by_shift(evidence, used),
        _sightings(evidence)[used],
    )
    if found is None or not _mixed(evidence, used[found.explained], used[~found.explained]):
        return ()
    more, fewer = np.count_nonzero(~found.explained), np.count_nonzero(found.explained)
    return (_second(found.shift, f"{fewer} of the {len(used)} rows that were used", int(more), "remain"),)


def _sightings(evidence: Evidence) -> NDArray[np.int64]:
    sightings = evidence.table.sightings
    return np.arange(len(evidence.table)) if sightings is None else sightings.astype(np.int64)


def _by_shift(evidence: Evidence, rows: NDArray[np.int64]) -> Array:
    axes = evidence.transform.rotation[:, : evidence.table.dimension]
    return evidence.mapped.across(rows, np.broadcast_to(axes, (len(rows), *axes.shape)))


def _motions(evidence: Evidence, rows: NDArray[np.int64]) -> Array:
    moved = point_jacobian(evidence.transform, evidence.table.points[rows], evidence.parameters)
    return evidence.mapped.across(rows, moved)


def _mixed(evidence: Evidence, rows: NDArray[np.int64], others: NDArray[np.int64]) -> bool:
    """Whether the two alternate in time as chance would have it: those before and after a slip do not."""
    assert evidence.table.frame is not None
    kind = np.full(len(evidence.table), -1)
    kind[others], kind[rows] = 0, 1
    kind = kind[np.argsort(evidence.table.frame, kind="stable")]
    kind = kind[kind >= 0][:: evidence.table.dimension - 1]  # of a line of a volume, one of its points
    share = float(np.mean(kind))
    changes = np.count_nonzero(np.diff(kind))
    return bool(changes >= MIXED * 2.0 * share * (1.0 - share) * len(kind))


def _second(shift_mm: Array, which: str, others: int, what: str) -> Diagnostic:
    length = float(np.linalg.norm(shift_mm))
    depth = float(shift_mm[1]) / length
    if abs(depth) > SIDEWAYS:
        where = "deeper than" if depth > 0 else "nearer to the transducer than"
        likelier = (
            f"the {'others' if depth > 0 else 'first'} are likelier the needle, as echoes come after it"
        )
    else:
        where = f"to the {'right' if shift_mm[0] > 0 else 'left'} of"
        likelier = "nothing in the rows tells which of the two is the needle"
    return Diagnostic(
        code="second-needle",
        severity="warning",
        message=(
            f"{which} lie {length:.1f} mm {where} the {others} that {what}, all by one shift, as of a second needle or "
            f"an echo: {likelier}"
        ),
        advice=(
            "look at these rows in the images; if they are the needle, the calibration is off by that much: keep the "
            "points of one needle only"
        ),
    )
