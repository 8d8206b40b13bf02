"""Two definitions of a marker, used by turns: the lines of part of the rows are off by one rigid motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.registration.mapped import MappedRows
from sonocal.registration.two_motions import two_motions
from sonocal.registration.uncertainty import point_jacobian
from sonocal.registration.whitened import across_lines
from sonocal.setup_checks.evidence import Evidence

__all__ = ["check_two_markers"]

# Fewer sightings part in two by chance; more than the most tell no more.
FEWEST, MOST = 40, 1000
# Of the logarithm of how much likelier two lumps are than one as wide: sound scans reach 12, errors of other kinds 21,
# two definitions of a marker that are 2 mm apart and more where things are seen 70.
SURE = 25.0
LEAST_SHARE = 0.15
# Of the median residual: gross errors further out make lumps of their own.
FURTHEST_OUT = 4.0


def check_two_markers(evidence: Evidence) -> Iterator[Diagnostic]:
    """Does one rigid motion of their lines part the rows that were used in two lumps with little in between?

    Only of a table of one needle: wires that are not where they are said to be make lumps, too.
    """
    table, away = evidence.table, evidence.mapped.distances
    assert table.target is not None
    if len(np.unique(table.target)) > 1 or not evidence.inlier.any():
        return
    if not isinstance(evidence.mapped, MappedRows):
        return
    used = np.flatnonzero(evidence.inlier & (away <= FURTHEST_OUT * np.median(away[evidence.inlier])))
    sightings = np.arange(len(table)) if table.sightings is None else table.sightings
    groups = np.unique(sightings[used])
    if len(groups) < FEWEST:
        return
    used = used[np.isin(sightings[used], groups[:: 1 + len(groups) // MOST])]
    basis = across_lines(evidence.mapped.directions[used])
    motions = basis @ point_jacobian(evidence.transform, table.points[used], evidence.parameters)
    found = two_motions(
        np.einsum("nij,nj->ni", basis, evidence.mapped.residuals[used]),
        motions,
        motions[:, :, :6],
        np.unique(sightings[used], return_inverse=True)[1].reshape(-1),
    )
    fewer = min(float(np.mean(found.second > 0.5)), float(np.mean(found.second <= 0.5)))
    if found.gain < SURE or fewer < LEAST_SHARE:
        return
    moved = float(np.sqrt(np.mean(np.sum(found.moved**2, axis=1))))
    yield Diagnostic(
        code="two-markers",
        severity="warning",
        message=(
            f"the lines of {100 * fewer:.0f} % of the sightings are off from those of the others by one rigid motion "
            f"that moves them by {moved:.1f} mm, as of two definitions or two faces of a marker, used by turns"
        ),
        advice="look at which definition of the probe's and the needle's marker was tracked when; calibrate one alone",
    )
