"""What the best of all tests could see of a fault: one that knows the fault's exact form, the noise and the truth.

NumPy and SciPy alone. A fault adds the vector m to residuals of unit variance, of which the similarity takes up a part;
the likelihood ratio of a fault of that form and any size is off by |(I - J J+) m|, in standard deviations of its
normal distribution: the deflection. No test of the same rows has more power (Neyman and Pearson 1933). Where the rows
do not tell which of several independent forms a fault has, the best that treats them alike is the sum of their squares,
a noncentral chi-squared with that freedom.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2, ncx2

from benchmarks.simulators.trust_faults import KINDS
from benchmarks.simulators.trust_scans import Array, Scan, mapped

SIGMA_PX, SIGMA_MM = 1.0, 0.4

# Shown: one false alarm in a hundred sound scans, and missed once in a thousand.
FALSE_ALARMS, FOUND = 0.01, 0.999


def deflection(name: str, strength: float, seed: int) -> float:
    """How many standard deviations the fault is beyond what a similarity takes up; inf where no strength is none."""
    kind = KINDS[name]
    if kind.nothing is None:
        return np.inf
    faulty, without = (kind.make(seed, x).scan for x in (strength, kind.nothing))
    if len(faulty.points_px) != len(without.points_px):
        return np.inf
    # The same noise is in both: what is left is the fault's.
    across, roots = _across(without), _noise_roots(without)
    change = _residuals(faulty, without.truth, across) - _residuals(without, without.truth, across)
    white = np.linalg.solve(roots, np.concatenate([_derivatives(without, across), change[..., None]], axis=2))
    flat = white.reshape(-1, 8)
    taken_up = np.linalg.qr(flat[:, :7] / np.linalg.norm(flat[:, :7], axis=0))[0]
    return float(np.linalg.norm(flat[:, 7] - taken_up @ (taken_up.T @ flat[:, 7])))


def best_power(name: str, deflected: float) -> float:
    """How often the best test finds a fault of this kind and deflection, with so many false alarms."""
    forms = KINDS[name].forms
    # SciPy gives NaN of none.
    return float(ncx2.sf(chi2.isf(FALSE_ALARMS, forms), forms, max(deflected, 1e-9) ** 2))


def shown(name: str, deflected: float) -> bool:
    """Whether the rows show a fault of this kind and deflection, to the best of all tests."""
    return bool(np.isinf(deflected)) or best_power(name, deflected) >= FOUND


def _lines(scan: Scan) -> tuple[Array, Array, Array]:
    """First ends (N, 3), directions (N, 3) and lengths (N, 1), mm, in the probe marker's frame."""
    segments = scan.segments_mm()
    along = segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    return segments[:, 0], along / length, length


def _across(scan: Scan) -> Array:
    """(N, 2, 3): two axes across each line."""
    directions = _lines(scan)[1]
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def _residuals(scan: Scan, truth: Array, across: Array) -> Array:
    """(N, 2 P), mm: from the lines to the points as the truth maps them, along the axes."""
    start, directions, _ = _lines(scan)
    away = mapped(truth, scan.points_px) - start[:, None]
    away -= np.einsum("npi,ni->np", away, directions)[..., None] * directions[:, None]
    return np.einsum("nki,npi->npk", across, away).reshape(len(away), -1)


def _derivatives(scan: Scan, across: Array) -> Array:
    """(N, 2 P, 7) by a turn, a shift and a logarithm of the scale."""
    turned = mapped(scan.truth, scan.points_px) - scan.truth[:3, 3]
    shape = (*turned.shape[:2], 3, 3)
    columns = np.concatenate(
        [-np.cross(turned[:, :, None], np.eye(3)), np.broadcast_to(np.eye(3), shape), turned[..., None]],
        axis=3,
    )
    return np.einsum("nki,npij->npkj", across, columns).reshape(len(turned), -1, 7)


def _noise_roots(scan: Scan) -> Array:
    """(N, 2 P, 2 P): roots of the residuals' covariance; points of one sighting share the noise of its ends."""
    start, directions, length = _lines(scan)
    place = np.einsum("npi,ni->np", mapped(scan.truth, scan.points_px) - start[:, None], directions) / length
    ends = SIGMA_MM * np.stack([1 - place, place], axis=2)
    seen = SIGMA_PX * _across(scan) @ scan.truth[:3, : scan.dimension]
    points = place.shape[1]
    covariance = np.einsum("npe,nqe,kl->npkql", ends, ends, np.eye(2))
    covariance += np.einsum("nkd,nld,pq->npkql", seen, seen, np.eye(points))
    return np.linalg.cholesky(covariance.reshape(len(place), 2 * points, 2 * points))


__all__ = ["best_power", "deflection", "shown"]
