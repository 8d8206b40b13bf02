"""An error of the lines that varies smoothly with where things are: neighbours in pose share it, whenever they were."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.mapped import MappedRows
from sonocal.registration.uncertainty import point_jacobian

__all__ = ["SmoothError", "smooth_error"]

# Rows that are looked at, one a frame, evenly from all: matrices of twice as many rows are taken apart.
MOST_ROWS, FEWEST_ROWS = 150, 24
# Lengths over which the error may change, in units of the median distance of two rows.
LENGTHS = (0.35, 0.7, 1.4)
# Of the error's variance to the rows' own, relative: what is tried.
RATIOS = np.logspace(-1.5, 2.5, 41)
# Of the smooth error's deviation to the residuals': what a fit takes up of an error may be more than it leaves, but an
# error that changes slowly shows so little of itself that its size would be anyone's guess.
MOST_TAKEN_UP = 4.0
# Standard deviations of the score below which the likelihood is not worth its time.
LEAST_SCORE = 1.0


@dataclass(frozen=True, eq=False)
class SmoothError:
    """What the residuals say of it.

    Attributes:
        sigma_mm: its standard deviation along each axis.
        own_mm: of the rows' own errors.
        length: over which it changes, in units of the places.
        gain: twice the logarithm of how much likelier it makes the residuals.
        independent: as many independent ones it has shown.
        covariance: (k, k): what it adds to the tangent's.
    """

    sigma_mm: float
    own_mm: float
    length: float
    gain: float
    independent: float
    covariance: Array


def smooth_error(
    mapped: MappedRows,
    chosen: NDArray[np.bool_],
    places: Array,
    rotations: Array,
    parameters: int,
    *,
    drift: tuple[Array, float, float] | None = None,
) -> SmoothError | None:
    """The smooth error that makes residuals of neighbours in pose go together, if one makes them likelier.

        r_i = P_i (J_i d + R_i g(x_i) + e_i)        g: a Gaussian process, each axis alike

    Its size and length are found by restricted maximum likelihood. With it the fit's covariance grows by
    H K H', K the process' covariance and H the fit; part of g looks like a motion of the transform, and shows nowhere.

    Args:
        mapped: rows under the transform.
        chosen: (N,): those to look at.
        places: (N, p): where things were, in numbers of which like distances mean like much.
        rotations: (N, 3, 3), from the frame of g to the lines' own.
        parameters: k, of the transform's tangent.
        drift: what neighbours in time share, which is another matter: each row's time (N,), the time after which its
            correlation has fallen to 1 / e, and its standard deviation relative to the rows' own.

    Returns:
        None where rows are too few, or neighbours have nothing in common.

    Source: Patterson and Thompson 1971 (restricted likelihood); Cressie, Statistics for Spatial Data, 1993.
    """
    rows = _one_a_frame(mapped, chosen)
    if len(rows) < FEWEST_ROWS:
        return None
    basis = _across(mapped.directions[rows])
    turned = (basis @ rotations[rows]).reshape(-1, 3)
    design = basis @ point_jacobian(mapped.transform, mapped.table.points[rows], parameters)
    design = design.reshape(-1, parameters)
    residuals = np.einsum("nij,nj->ni", basis, mapped.residuals[rows]).reshape(-1)
    taken = np.concatenate(
        [design / np.linalg.norm(design, axis=0), _of_targets(mapped, rows, turned)], axis=1
    )
    kernels = list(_kernels(_distances(places[rows]), turned @ turned.T))
    found = _likeliest(residuals, taken, kernels)
    if found is None:
        return None
    gain = found.gain
    if drift is not None:
        time, memory, ratio = drift
        whitening = _without(time[rows] / memory, ratio, basis.reshape(-1, 3))
        beside = [(length, whitening @ kernel @ whitening.T) for length, kernel in kernels]
        further = _likeliest(whitening @ residuals, whitening @ taken, beside)
        gain = 0.0 if further is None else min(gain, further.gain)
    hat = np.linalg.pinv(design)
    covariance = found.shared * hat @ dict(kernels)[found.length] @ hat.T
    return SmoothError(sqrt(found.shared), sqrt(found.own), found.length, gain, found.independent, covariance)


def _kernels(apart: Array, shared: Array) -> Iterator[tuple[float, Array]]:
    """Lengths, and the covariances (2 N, 2 N) that an error of unit variance has which changes over them."""
    usual = float(np.median(apart[np.triu_indices(len(apart), 1)]))
    for length in LENGTHS:
        if usual > 0:
            yield length * usual, shared * _twice(np.exp(-0.5 * (apart / (length * usual)) ** 2))


def _without(time: Array, ratio: float, basis: Array) -> Array:
    """(2 N, 2 N): what makes errors independent that neighbours in time (N,), in units of their memory, share."""
    together = np.exp(-np.abs(time[:, None] - time))
    covariance = np.eye(len(basis)) + ratio**2 * _twice(together) * (basis @ basis.T)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _twice(each: Array) -> Array:
    """(2 N, 2 N) of (N, N): two residuals a row."""
    return np.repeat(np.repeat(each, 2, axis=0), 2, axis=1)


@dataclass(frozen=True)
class _Levels:
    """Variances, the length, how much likelier they are than one variance alone, and of how many independent errors."""

    own: float
    shared: float
    length: float
    gain: float
    independent: float


def _likeliest(residuals: Array, taken: Array, kernels: list[tuple[float, Array]]) -> _Levels | None:
    """Of residuals (m,) with covariance own I + shared kernel, whatever the columns taken (m, q) take up.

    Returns:
        None where nothing is shared.
    """
    rest = np.linalg.qr(taken, mode="complete")[0][:, np.linalg.matrix_rank(taken) :]
    levels = (_levels(rest.T @ residuals, rest.T @ kernel @ rest, length) for length, kernel in kernels)
    return max((one for one in levels if one is not None), key=lambda one: one.gain, default=None)


def _levels(residuals: Array, kernel: Array, length: float) -> _Levels | None:
    count = len(residuals)
    if count < FEWEST_ROWS:
        return None
    alone, mean = float(residuals @ residuals) / count, float(np.trace(kernel)) / count
    # The score's mean and deviation, were nothing shared.
    spread = sqrt(2.0 * count * max(float(np.sum(kernel**2)) / count - mean**2, 0.0))
    if not residuals @ kernel @ residuals > alone * (count * mean + LEAST_SCORE * spread):
        return None
    values, vectors = np.linalg.eigh(kernel)
    values, squares = np.maximum(values, 0.0), (vectors.T @ residuals) ** 2
    ratios = RATIOS / mean
    inflated = 1.0 + ratios[:, None] * values
    own = np.mean(squares / inflated, axis=1)
    gains = count * np.log(alone / own) - np.log(inflated).sum(axis=1)
    gains[own * ratios > MOST_TAKEN_UP**2 * alone] = -np.inf
    at = int(np.argmax(gains))
    if not gains[at] > 0:
        return None
    independent = float(np.sum((1.0 - 1.0 / inflated[at]) ** 2))
    return _Levels(float(own[at]), float(own[at] * ratios[at]), length, float(gains[at]), independent)


def _one_a_frame(mapped: MappedRows, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """One row of each frame, in turn, for rows of one frame share more: of up to so many frames."""
    frame = mapped.table.frame
    assert frame is not None
    rows = np.flatnonzero(chosen)
    rows = rows[np.argsort(frame[rows], kind="stable")]
    first = np.flatnonzero(np.diff(frame[rows], prepend=-1))
    count = np.diff(first, append=len(rows))
    picked = rows[first + np.arange(len(first)) % np.maximum(count, 1)]
    kept = np.linspace(0, len(picked) - 1, min(MOST_ROWS, len(picked))).astype(int)
    return np.asarray(picked[np.unique(kept)])


def _across(directions: Array) -> Array:
    """(N, 2, 3): two axes across each direction (N, 3)."""
    return np.asarray(np.linalg.svd(directions[:, None])[2][:, 1:])


def _of_targets(mapped: MappedRows, rows: NDArray[np.int64], turned: Array) -> Array:
    """(2 N, 3 T): an offset of each of several targets, which is another matter; none of a single one."""
    target = mapped.table.target
    assert target is not None
    names, which = np.unique(target[rows], return_inverse=True)
    if len(names) == 1:
        return np.zeros((len(turned), 0))
    hot = np.repeat(which.reshape(-1) == np.arange(len(names))[:, None], 2, axis=1).T
    return np.asarray((hot[:, :, None] * turned[:, None]).reshape(len(turned), -1))


def _distances(places: Array) -> Array:
    """(N, N)."""
    squares = np.einsum("np,np->n", places, places)
    return np.asarray(np.sqrt(np.maximum(squares[:, None] + squares - 2.0 * places @ places.T, 0.0)))
