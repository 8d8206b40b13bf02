"""Points beside their lines that one shift explains: the lines are there twice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array

__all__ = ["Copy", "common_shift", "lies_one_way", "parted"]

TRIALS, TURNS = 400, 100
# Shifts that are tried in one go.
TOGETHER = 25
# Ways that differ, among which the fullest is looked at.
WAYS = 20
REFINEMENTS = 3
# Shifts that chance is measured with reach this many times as far as the one that was found.
REACH = 2.0
# The logarithm of a probability: below it what agrees does not do so by chance.
LOG_CHANCE = float(np.log(1e-3))
LEAST_GROUPS = 5
# A split of normal errors in two leaves 0.68 of the squares of two components, and of those in between a lot.
LEFT_OF_SQUARES, LEFT_BETWEEN = 0.4, 0.06
LEAST_PART = 0.15
BETWEEN = (0.35, 0.65)
ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Copy:
    """A shift, and what it explains.

    Attributes:
        shift: (k,), mm.
        explained: (M,): which displacements it explains.
        groups: how many groups they are of.
    """

    shift: Array
    explained: NDArray[np.bool_]
    groups: int


def common_shift(
    displaced: Array,
    by_shift: Array,
    groups: NDArray[np.int64],
    *,
    within_mm: float,
    among: int,
    seed: int = 0,
) -> Copy | None:
    """The shift that explains displacements of most groups, if it is no chance.

        displaced_i = by_shift_i shift

    Args:
        displaced: (M, e), mm: of points from where they should be.
        by_shift: (M, e, k): what a shift of 1 mm along each of k axes does to them.
        groups: (M,): of each sighting at most one displacement is explained.
        within_mm: how near explained is.
        among: how many groups there are, with those that have no displacement.
        seed: of the samples.

    Returns:
        None where none is, or where as many would be explained by chance.

    Source: random samples as in RANSAC; number of false alarms: Moisan and Stival 2004, with the chance measured.
    """
    if len(np.unique(groups)) < LEAST_GROUPS:
        return None
    rng = np.random.default_rng(seed)
    rank = by_shift.shape[2]
    each = 1 if np.linalg.matrix_rank(by_shift[0], tol=1e-6) == rank else 2
    samples = rng.integers(0, len(displaced), (TRIALS, each))
    trials = _solved(by_shift[samples].reshape(TRIALS, -1, rank), displaced[samples].reshape(TRIALS, -1))
    counts = _groups_each(displaced, by_shift, groups, trials, within_mm)
    shift = trials[int(np.argmax(counts))]
    for _ in range(REFINEMENTS):
        near = _near(displaced, by_shift, shift, within_mm)
        if not near.any():
            return None
        shift = _solved(by_shift[near].reshape(1, -1, rank), displaced[near].reshape(1, -1))[0]
    explained = _near(displaced, by_shift, shift, within_mm)
    found = Copy(shift, explained, len(np.unique(groups[explained])))
    others = _elsewhere(rng, shift, trials.shape[1], within_mm)
    chance = np.mean(_groups_each(displaced, by_shift, groups, others, within_mm))
    return (
        found if found.groups >= LEAST_GROUPS and _is_no_chance(found.groups, among, float(chance)) else None
    )


def _solved(by_shift: Array, displaced: Array) -> Array:
    """(T, k): least squares."""
    return np.asarray(np.einsum("tke,te->tk", np.linalg.pinv(by_shift), displaced))


def _near(displaced: Array, by_shift: Array, shift: Array, within_mm: float) -> NDArray[np.bool_]:
    left = displaced - by_shift @ shift
    return np.asarray(np.einsum("ne,ne->n", left, left) <= within_mm**2)


def _groups(
    displaced: Array, by_shift: Array, groups: NDArray[np.int64], shift: Array, within_mm: float
) -> int:
    return len(np.unique(groups[_near(displaced, by_shift, shift, within_mm)]))


def _groups_each(
    displaced: Array, by_shift: Array, groups: NDArray[np.int64], shifts: Array, within_mm: float
) -> NDArray[np.int64]:
    """(T,): as `_groups`, of shifts (T, k) by the dozen: one after the other they are most of what a fit takes."""
    order = np.argsort(groups, kind="stable")
    sorted_groups = groups[order]
    starts = np.flatnonzero(np.concatenate([[True], sorted_groups[1:] != sorted_groups[:-1]]))
    places, moved_by = displaced[order].T.copy(), np.moveaxis(by_shift[order], 0, -1).copy()
    counts = [
        np.logical_or.reduceat(_near_each(places, moved_by, some, within_mm), starts, axis=1).sum(axis=1)
        for some in np.array_split(shifts, max(1, len(shifts) // TOGETHER))
    ]
    return np.concatenate(counts)


def _near_each(places: Array, moved_by: Array, shifts: Array, within_mm: float) -> NDArray[np.bool_]:
    """(T, M), of displacements (e, M), and what shifts do to them (e, k, M): whether a shift (T, k) explains them."""
    squares = np.zeros((len(shifts), places.shape[1]))
    for place, moved in zip(places, moved_by, strict=True):
        left = place - sum(shifts[:, k, None] * moved[k] for k in range(shifts.shape[1]) if moved[k].any())
        squares += left * left
    return np.asarray(squares <= within_mm**2)


def _elsewhere(rng: np.random.Generator, shift: Array, axes: int, within_mm: float) -> Array:
    """(T, k): shifts of about the same length that are not the one that was found."""
    length = max(float(np.linalg.norm(shift)), 4.0 * within_mm)
    drawn = rng.uniform(-REACH * length, REACH * length, (TRIALS, axes))
    return np.asarray(drawn[np.linalg.norm(drawn - shift, axis=1) > 2.0 * within_mm])


def _is_no_chance(count: int, among: int, by_chance: float, trials: int = TRIALS) -> bool:
    """Whether so many of all groups would hardly be explained by the best of all shifts that were tried."""
    from scipy.special import bdtrc

    chance = (by_chance + 1.0) / (among + 2.0)
    tail = bdtrc(count - 2, among, min(chance, 1.0))
    return bool(tail == 0 or np.log(trials) + np.log(tail) < LOG_CHANCE)


def lies_one_way(
    found: Copy,
    displaced: Array,
    by_shift: Array,
    groups: NDArray[np.int64],
    directions: Array,
    *,
    within_mm: float,
    seed: int = 0,
) -> bool:
    """Whether a shift explains more than it would of displacements as long that point anywhere, or the other way.

    What a threshold cuts off normal errors lies in a ring about the line: the shift to any place of the ring explains
    the part of it that is near, however many that are.

    Args:
        found: the shift.
        displaced: (M, 3), mm, across the lines.
        by_shift: (M, 3, k), as of `common_shift`.
        groups: (M,): displacements of a group, which are about one line, are turned about it as one.
        directions: (M, 3), of the lines.
        within_mm: how near explained is.
        seed: of the turns.

    Source: permutation test; the group is that of turns about the lines.
    """
    codes = np.unique(groups, return_inverse=True)[1].reshape(-1)
    among, quarter_turn = int(codes.max()) + 1, np.cross(directions, displaced)
    angles = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (TURNS, among))[:, codes, None]
    turned = [
        _groups(
            np.cos(angle) * displaced + np.sin(angle) * quarter_turn, by_shift, codes, found.shift, within_mm
        )
        for angle in angles
    ]
    opposite = _groups(displaced, by_shift, codes, -found.shift, within_mm)
    return _is_no_chance(found.groups, among, max(float(np.mean(turned)), float(opposite)), WAYS)


def parted(residuals: Array, motions: Array, by_shift: Array, groups: NDArray[np.int64]) -> Copy | None:
    """The shift that parts the residuals in two heaps with a gap between them, if one does.

        r_i = motions_i m + by_shift_i shift z_i        z_i: 0 or 1, of a group alike

    Args:
        residuals: (N, 3), mm, across the lines.
        motions: (N, 3, m): what the transform's motions do to them.
        by_shift: (N, 3, k): what a shift of 1 mm along each of k axes does to them.
        groups: (N,), of rows that are on the same side.

    Returns:
        The shift of the smaller part from the larger one; None where there is one heap.

    Source: k-means with the fit's own parameters, k = 2 (Lloyd 1982).
    """
    codes = np.unique(groups, return_inverse=True)[1].reshape(-1)
    pulled = np.einsum("nek,ne->nk", by_shift, residuals)
    found = [
        _halved(residuals, motions, by_shift, codes, pulled @ axis > 0)
        for axis in np.linalg.eigh(pulled.T @ pulled)[1].T
    ]
    shift, side, squares, between = min(found, key=lambda one: one[2])
    share = float(np.mean(side))
    if squares > LEFT_OF_SQUARES or between > LEFT_BETWEEN or not LEAST_PART <= share <= 1.0 - LEAST_PART:
        return None
    smaller = side if share <= 0.5 else ~side
    return Copy(shift if share <= 0.5 else -shift, smaller, len(np.unique(codes[smaller])))


def _halved(
    residuals: Array, motions: Array, by_shift: Array, codes: NDArray[np.int64], side: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_], float, float]:
    """From a first guess of the sides: shift, sides, share of the squares that is left, share of groups in between."""
    count, axes = int(codes.max()) + 1, by_shift.shape[2]
    for _ in range(ROUNDS):
        design = np.concatenate([motions, by_shift * side[:, None, None]], axis=2).reshape(residuals.size, -1)
        solved = np.linalg.lstsq(design, residuals.reshape(-1), rcond=None)[0]
        base, moved = residuals - motions @ solved[:-axes], by_shift @ solved[-axes:]
        lengths = np.bincount(codes, np.sum(moved**2, axis=1), count)
        place = np.bincount(codes, np.sum(base * moved, axis=1), count) / np.maximum(
            lengths, np.finfo(float).tiny
        )
        before, side = side, place[codes] > 0.5
        if np.array_equal(before, side) or side.all() or not side.any():
            break
    left = float(np.sum((base - moved * side[:, None]) ** 2))
    between = float(np.mean((place > BETWEEN[0]) & (place < BETWEEN[1])))
    return solved[-axes:], side, left / max(float(np.sum(residuals**2)), np.finfo(float).tiny), between
