"""How far a similarity of a mix may be off, when the rows of one correspondence share their errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array, Similarity

__all__ = ["Covariance", "covariance_of_mix", "tangent_rows"]

# Of the design's pivots, in coordinates of order one: below it a motion is free.
FREE = 1e-9
# Each round is a few products of 7 x 7; levels that change by less than this part of them are at rest.
MOST_ROUNDS, AT_REST = 30, 1e-3
# A level that so few degrees of freedom are left to tell is taken for that of all rows, and for this unsure.
FEWEST_SPARE = 0.5
# A level that s degrees of freedom tell is at least 1 / (2 + s) of the mean square: a few residuals that happen to be
# small do not show that a part has no error, and with a level of nothing no truth lies within the region stated.
AHEAD = 2.0


@dataclass(frozen=True, eq=False)
class Covariance:
    """What residuals say of a similarity's error.

    Attributes:
        matrix: (7, 7), of the tangent about the source's origin.
        freedom: degrees of freedom behind it: of Student's t for any one direction, and of F(7, freedom) for a
            seventh of the squared error in units of it.
    """

    matrix: Array
    freedom: float


@dataclass(frozen=True, eq=False)
class Parts:
    """Projections B_l of the rows that add up to one, seen in an orthonormal basis Q of the design.

    Attributes:
        counts: (L,), the rank of each.
        grams: (L, k, k): Q' B_l Q.
        cross: (L, k): Q' B_l r.
        squares: (L,): r' B_l r.
    """

    counts: Array
    grams: Array
    cross: Array
    squares: Array


def covariance_of_mix(
    points: Array,
    planes: Array,
    first: NDArray[np.int32],
    similarity: Similarity,
    weights: Array | None = None,
    *,
    scale_known: bool = False,
) -> Covariance | None:
    """The covariance of least squares on rows whose errors are shared within a correspondence.

    With r = J x + e, e independent between correspondences, and two levels for each kind of correspondence:

        cov e = sum_l level_l B_l        cov x = (J'J)^-1 J' (sum_l level_l B_l) J (J'J)^-1

    B_l takes the average of a correspondence's rows over its points, along each of its normals, or what differs from
    that average: what moves all of a line or a plane, and what moves its points against each other. Levels are those
    of restricted maximum likelihood; how sure they are gives the degrees of freedom (Satterthwaite), as a mean over
    all directions.

    Args:
        points: (N, 3), of the rows that were fitted, as in `Rows`.
        planes: (N, 4), likewise.
        first: (C + 1,), likewise.
        similarity: what least squares made of them.
        weights: (N,), what the rows' residuals were multiplied by; None: all alike.
        scale_known: the scale was not fitted; its row and column are zero.

    Returns:
        None where no row is left to tell the noise, the rows leave a motion free, or the numbers have no squares.

    Source: Patterson and Thompson 1971; Satterthwaite 1946. A level for each kind and not each correspondence's own
        residual (Liang and Zeger 1986), which leaves few degrees of freedom.
    """
    design, residuals, to_origin = tangent_rows(points, planes, similarity, weights)
    if scale_known:
        design, to_origin = design[:, :6], to_origin[:, :6]
    if len(design) <= design.shape[1]:
        return None
    basis, triangle = np.linalg.qr(design)
    pivots = np.abs(np.diag(triangle))
    if not pivots.min() > FREE * pivots.max():
        return None
    meat, freedom = _meat(basis, residuals - basis @ (basis.T @ residuals), points, planes, first)
    back = to_origin @ np.linalg.inv(triangle)
    # Places of absurd size have squares that are no numbers.
    with np.errstate(over="ignore", invalid="ignore"):
        matrix = np.asarray(back @ meat @ back.T)
    return Covariance(matrix, freedom) if np.isfinite(matrix).all() else None


def tangent_rows(
    points: Array, planes: Array, similarity: Similarity, weights: Array | None = None
) -> tuple[Array, Array, Array]:
    """Rows' derivatives (N, 7) and residuals (N,), in coordinates of order one about the points' centre.

    Returns:
        Derivatives, residuals, and the matrix (7, 7) that takes the tangent there to that about the origin.
    """
    arms = similarity.scale * points @ similarity.rotation.T
    centre = arms.mean(axis=0)
    size = max(float(np.abs(arms - centre).max()), 1e-300)
    normals = planes[:, :3]
    residuals = np.einsum("ij,ij->i", arms + similarity.translation, normals) + planes[:, 3]
    arms = (arms - centre) / size
    design = np.column_stack([np.cross(arms, normals), normals, np.einsum("ij,ij->i", arms, normals)])
    if weights is not None:
        design, residuals = design * weights[:, None], residuals * weights
    # Turns and growth about the centre move the origin, too.
    to_origin = np.diag([*[1 / size] * 3, *[1.0] * 3, 1 / size])
    x, y, z = centre / size
    to_origin[3:6, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    to_origin[3:6, 6] = -centre / size
    return design, residuals, to_origin


def _meat(
    basis: Array, residuals: Array, points: Array, planes: Array, first: NDArray[np.int32]
) -> tuple[Array, float]:
    """(k, k), covariance of least squares in an orthonormal basis (N, k) of the design; its degrees of freedom."""
    rows, motions = basis.shape
    common = float(residuals @ residuals) / (rows - motions)
    if not common > 0:
        return np.zeros((motions, motions)), float(rows - motions)
    parts = _parts(basis, residuals, points, planes, first)
    if len(parts.counts) == 1:
        return common * np.eye(motions), float(rows - motions)
    levels = _levels(parts, common)
    meat = np.einsum("l,lab->ab", levels, parts.grams)
    return meat, min(_freedom(parts, levels, meat), float(rows - motions))


def _parts(basis: Array, residuals: Array, points: Array, planes: Array, first: NDArray[np.int32]) -> Parts:
    of_row = np.repeat(np.arange(len(first) - 1), np.diff(first))
    kind = _kinds(points, of_row, np.diff(first))[of_row]
    # Rows of one correspondence and one normal: those that an average over its points is of.
    keys = np.column_stack([of_row, planes[:, :3]])
    group, members = np.unique(keys, axis=0, return_inverse=True, return_counts=True)[1:]
    both = np.column_stack([basis, residuals])
    sums = np.zeros((len(members), both.shape[1]))
    np.add.at(sums, group.reshape(-1), both)
    mean = (sums / members[:, None])[group.reshape(-1)]
    found = []
    for one in np.unique(kind):
        chosen = kind == one
        averages = float(np.sum(1.0 / members[group.reshape(-1)][chosen]))
        for count, part in ((averages, mean[chosen]), (chosen.sum() - averages, (both - mean)[chosen])):
            if round(count) > 0:
                found.append((count, part.T @ part))
    products = np.array([product for _, product in found])
    counts = np.array([count for count, _ in found])
    return Parts(counts, products[:, :-1, :-1], products[:, :-1, -1], products[:, -1, -1])


def _kinds(points: Array, of_row: NDArray[np.int64], rows: NDArray[np.int32]) -> NDArray[np.int64]:
    """(C,): correspondences with as many rows and points are of one kind."""
    new = (of_row[1:] == of_row[:-1]) & np.any(points[1:] != points[:-1], axis=1)
    others = np.bincount(of_row[1:], weights=new, minlength=len(rows)).astype(int)
    return np.unique(np.column_stack([rows, others]), axis=0, return_inverse=True)[1].reshape(-1)


def _levels(parts: Parts, common: float) -> Array:
    """(L,): variances at which each part's squares, of what generalised least squares leaves, are as expected."""
    levels = np.full(len(parts.counts), common)
    for _ in range(MOST_ROUNDS):
        inverse = np.linalg.inv(np.einsum("l,lab->ab", 1 / levels, parts.grams))
        shift = inverse @ np.einsum("l,la->a", 1 / levels, parts.cross)
        left = parts.squares - 2 * parts.cross @ shift + shift @ parts.grams @ shift
        spare = parts.counts - np.einsum("ab,lba->l", inverse, parts.grams) / levels
        told = spare > FEWEST_SPARE
        new = np.where(told, left / np.where(told, spare, 1.0), common)
        new = np.maximum(new, common / (AHEAD + np.maximum(spare, 0.0)))
        change = float(np.abs(np.log(new / levels)).max())
        levels = new
        if change < AT_REST:
            break
    return levels


def _freedom(parts: Parts, levels: Array, meat: Array) -> float:
    """Degrees of freedom of the covariance, a mean over all directions; Fisher information of the levels."""
    inverse = np.linalg.inv(np.einsum("l,lab->ab", 1 / levels, parts.grams))
    shares = inverse @ parts.grams
    traces = np.einsum("laa->l", shares)
    told = parts.counts - traces / levels > FEWEST_SPARE
    information = np.einsum("lab,mba->lm", shares, shares) / np.outer(levels, levels) ** 2
    information += np.diag(parts.counts / levels**2 - 2 * traces / levels**3)
    information[~told] = information[:, ~told] = 0.0
    information += np.diag(np.where(told, 0.0, FEWEST_SPARE / levels**2))
    unsure = 2.0 * np.linalg.pinv(information, hermitian=True)
    relative = np.linalg.solve(meat, parts.grams)
    size = np.einsum("laa->l", relative)
    directions = np.outer(size, size) + 2.0 * np.einsum("lab,mba->lm", relative, relative)
    motions = len(meat)
    return float(2.0 * motions * (motions + 2) / np.sum(unsure * directions))
