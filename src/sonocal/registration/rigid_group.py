"""A similarity with the place of a whole phantom: its points, lines and planes keep their places to one another.

    N_k (T^-1 P_i^-1 A x_i - p_k) = 0        P_i: the marker from the body, T: the body from the phantom

Thirteen unknowns, whatever the number of wires. Rows of a frame share the noise of its pose: they are whitened
together, for a noise of the pixels and one of the pose, whose turn and shift go with each other as everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array, AxisScaled, Similarity
from sonocal.geometry.shown import brief
from sonocal.registration.uncertainty import point_jacobian
from sonocal.registration.unplaced_rows import RAD_PER_MM

__all__ = ["GroupFit", "GroupRows", "fit_group"]

STEPS, AT_REST = 40, 1e-7
ROUNDS = 4
# Rows of lines that hold thirteen unknowns and leave something to spare.
FEWEST = 8
# Noise of a pose's translation, mm, for that of a pixel.
RATIOS = tuple(0.01 * 1.6**k for k in range(15))


class GroupRows(NamedTuple):
    """Rows of a phantom's targets.

    Attributes:
        points: (N, 3), px.
        poses: (N, 4, 4): the marker from the body, mm.
        target: (N,): which target each is of.
        frame: (N,): the instant of each.
        spanning_mm: of each target, (K, 3), in the phantom's frame.
        tracked: whether the body has a tracked pose of its own, with noise too.
        dimension: 2 or 3, of the source.
    """

    points: Array
    poses: Array
    target: NDArray[np.int64]
    frame: NDArray[np.int64]
    spanning_mm: tuple[Array, ...]
    tracked: bool
    dimension: int


@dataclass(frozen=True, eq=False)
class GroupFit:
    """A similarity and a phantom's place.

    Attributes:
        transform: mm from px.
        body_from_phantom: (4, 4).
        covariance: (k + 6, k + 6): of the similarity's tangent, then of the phantom's turn (on the left, rad) and shift
            (mm); as the residuals show.
        levels: noise of a pixel, and of a pose's translation, mm, as the residuals show.
        squares: weighed squares of the residuals, at the levels given.
        freedom: residuals to spare.
        residuals_mm: (N,).
        inlier: (N,).
    """

    transform: AxisScaled
    body_from_phantom: Array
    covariance: Array
    levels: tuple[float, float]
    squares: float
    freedom: int
    residuals_mm: Array
    inlier: NDArray[np.bool_]

    __repr__ = brief


def fit_group(
    rows: GroupRows,
    start: tuple[AxisScaled, Array],
    levels: tuple[float, float],
    threshold_mm: float,
    inlier: NDArray[np.bool_],
) -> GroupFit:
    """The similarity and the phantom's place that fit best, from ones near them.

    Args:
        rows: of a phantom's targets.
        start: the similarity, and the body from the phantom.
        levels: noise of a pixel, and of a pose's translation, mm.
        threshold_mm: rows within this distance agree.
        inlier: (N,): those that agree to begin with.
    """
    normals = [normals_of_span(one) for one in rows.spanning_mm]
    state, given = start, levels
    for _ in range(ROUNDS):
        state = _settled(rows, state, levels, inlier, normals)
        away = _distances(rows, state, normals)
        before, inlier = inlier, away <= threshold_mm
        if np.array_equal(before, inlier) or inlier.sum() < FEWEST:
            break
    if inlier.sum() < max(FEWEST, len(inlier) / 2):
        unknowns = np.full((13, 13), np.nan)
        return GroupFit(state[0], state[1], unknowns, levels, np.inf, 0, away, inlier)
    levels = _likeliest(rows, state, levels, inlier, normals)
    state = _settled(rows, state, levels, inlier, normals)
    now = _normal_equations(rows, state, levels, inlier, normals)
    freedom = now.numbers - len(now.information)
    factor = now.squares / freedom if freedom > 0 else np.nan
    covariance = np.asarray(np.linalg.pinv(now.information, rcond=1e-16, hermitian=True) * factor)
    root = float(np.sqrt(factor))
    told = levels[0] * root, levels[1] * root
    at_start = _normal_equations(rows, state, given, inlier, normals).squares
    return GroupFit(state[0], state[1], covariance, told, at_start, freedom, away, inlier)


class _Equations(NamedTuple):
    """Normal equations: information, right side, squares and number of residuals, and the logarithm of their spread."""

    information: Array
    right: Array
    squares: float
    numbers: int
    log_spread: float


def _likeliest(
    rows: GroupRows,
    state: tuple[AxisScaled, Array],
    levels: tuple[float, float],
    inlier: NDArray[np.bool_],
    normals: Sequence[Array],
) -> tuple[float, float]:
    """Noise of a pixel and of a pose, by the ratio that makes the residuals likeliest, of the size that they have."""

    def cost(ratio: float) -> tuple[float, float]:
        tried = _normal_equations(rows, state, (1.0, ratio), inlier, normals)
        size = tried.squares / max(tried.numbers - len(tried.information), 1)
        return tried.numbers * np.log(max(size, 1e-300)) + tried.log_spread, size

    best = min(RATIOS, key=lambda ratio: cost(ratio)[0])
    root = float(np.sqrt(cost(best)[1]))
    return (max(root, 1e-6), max(best * root, 1e-6))


def normals_of_span(spanning: Array) -> Array:
    """(M, 3): directions at right angles to what points (K, 3) span."""
    if len(spanning) == 1:
        return np.eye(3)
    return np.asarray(np.linalg.svd(spanning[1:] - spanning[0])[2][len(spanning) - 1 :])


def _settled(
    rows: GroupRows,
    state: tuple[AxisScaled, Array],
    levels: tuple[float, float],
    inlier: NDArray[np.bool_],
    normals: Sequence[Array],
) -> tuple[AxisScaled, Array]:
    """Gauss and Newton's steps, damped where they would grow the squares."""
    damping, now = 0.0, _normal_equations(rows, state, levels, inlier, normals)
    for _ in range(STEPS):
        scaled = now.information + damping * np.diag(np.diag(now.information))
        step = np.asarray(np.linalg.lstsq(scaled, now.right, rcond=1e-15)[0], dtype=float)
        tried = _stepped(state, step)
        after = _normal_equations(rows, tried, levels, inlier, normals)
        if after.squares <= now.squares * (1 + 1e-12):
            rests = now.squares - after.squares <= AT_REST * now.squares
            state, now, damping = tried, after, damping / 10
            if rests:
                break
        else:
            damping = max(10 * damping, 1e-4)
            if damping > 1e8:
                break
    return state


def _stepped(state: tuple[AxisScaled, Array], step: Array) -> tuple[AxisScaled, Array]:
    from scipy.spatial.transform import Rotation

    transform, place = state
    grown = len(step) - 12
    turn = Rotation.from_rotvec(step[:3]).as_matrix() @ transform.rotation
    if grown == 1:
        moved: AxisScaled = Similarity(
            turn, transform.translation + step[3:6], float(transform.scales[0] * np.exp(step[6]))
        )
    else:
        scales = transform.scales.copy()
        scales[:grown] *= np.exp(step[6 : 6 + grown])
        moved = AxisScaled(turn, transform.translation + step[3:6], scales)
    there = place.copy()
    there[:3, :3] = Rotation.from_rotvec(step[-6:-3]).as_matrix() @ place[:3, :3]
    there[:3, 3] += step[-3:]
    return moved, there


def _in_phantom(rows: GroupRows, state: tuple[AxisScaled, Array]) -> tuple[Array, Array, Array]:
    """(N, 3) each: of the rows' points, in the marker's, the body's and the phantom's frame."""
    transform, place = state
    marker = transform @ rows.points
    body = np.einsum("nji,nj->ni", rows.poses[:, :3, :3], marker - rows.poses[:, :3, 3])
    return marker, body, (body - place[:3, 3]) @ place[:3, :3]


def _distances(rows: GroupRows, state: tuple[AxisScaled, Array], normals: Sequence[Array]) -> Array:
    phantom = _in_phantom(rows, state)[2]
    away = np.zeros(len(phantom))
    for k, spanning in enumerate(rows.spanning_mm):
        mine = rows.target == k
        away[mine] = np.linalg.norm((phantom[mine] - spanning[0]) @ normals[k].T, axis=1)
    return away


def _normal_equations(
    rows: GroupRows,
    state: tuple[AxisScaled, Array],
    levels: tuple[float, float],
    inlier: NDArray[np.bool_],
    normals: Sequence[Array],
) -> _Equations:
    """Of rows whitened a frame at a time."""
    transform, place = state
    parameters = 7 if isinstance(transform, Similarity) else 8
    marker, body, phantom = _in_phantom(rows, state)
    to_phantom = np.einsum("ji,nkj->nik", place[:3, :3], rows.poses[:, :3, :3])
    of_image = to_phantom @ point_jacobian(transform, rows.points, parameters)
    arms = body - place[:3, 3]
    of_place = np.concatenate(
        [place[:3, :3].T @ _cross(arms), -np.broadcast_to(place[:3, :3].T, (len(arms), 3, 3))], axis=2
    )
    jacobian = np.concatenate([of_image, of_place], axis=2)
    pixels = to_phantom @ (transform.rotation * transform.scales)[:, : rows.dimension] * levels[0]
    turned = RAD_PER_MM * levels[1]
    shaken = [to_phantom @ -_cross(marker) * turned, to_phantom * levels[1]]
    if rows.tracked:
        shaken += [
            place[:3, :3].T @ -_cross(body) * turned,
            np.broadcast_to(place[:3, :3].T, to_phantom.shape) * levels[1],
        ]
    pose = np.concatenate(shaken, axis=2)
    size = parameters + 6
    information, right, squares, count, spreads = np.zeros((size, size)), np.zeros(size), 0.0, 0, 0.0
    order = np.flatnonzero(inlier)[np.argsort(rows.frame[inlier], kind="stable")]
    for mine in np.split(order, np.flatnonzero(np.diff(rows.frame[order])) + 1):
        held = [normals[rows.target[i]] for i in mine]
        residual = np.concatenate(
            [n @ (phantom[i] - rows.spanning_mm[rows.target[i]][0]) for n, i in zip(held, mine, strict=True)]
        )
        slope = np.concatenate([n @ jacobian[i] for n, i in zip(held, mine, strict=True)])
        shared = np.concatenate([n @ pose[i] for n, i in zip(held, mine, strict=True)])
        spread = shared @ shared.T
        at = 0
        for n, i in zip(held, mine, strict=True):
            own = n @ pixels[i]
            spread[at : at + len(n), at : at + len(n)] += own @ own.T
            at += len(n)
        root = np.linalg.cholesky(spread + 1e-18 * np.eye(len(spread)))
        whitened = np.linalg.solve(root, np.column_stack([residual, slope]))
        information += whitened[:, 1:].T @ whitened[:, 1:]
        right -= whitened[:, 1:].T @ whitened[:, 0]
        squares += float(whitened[:, 0] @ whitened[:, 0])
        count += len(residual)
        spreads += 2 * float(np.log(np.diag(root)).sum())
    return _Equations(information, right, squares, count, spreads)


def _cross(vectors: Array) -> Array:
    """(N, 3, 3): matrices that take the cross product of vectors (N, 3) with what they are applied to."""
    out = np.zeros((len(vectors), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    return out - out.swapaxes(1, 2)
