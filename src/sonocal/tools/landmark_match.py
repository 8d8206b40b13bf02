"""Which touch is which landmark: rigid motions of three touches onto three landmarks, and what else fits as well."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.geometry.fitted import fitted_motions

__all__ = ["LEAST_WIDTH_MM", "Match", "match_landmarks", "width_mm"]

# Triples of landmarks that are tried: all of eleven.
MOST_TRIPLES = 165
# Points that are no further from one line tell nothing of a turn about it, mm.
LEAST_WIDTH_MM = 5.0
# Three touches carry their errors to the others.
CARRIED = 2.5
KEPT = 200
REFITS = 5


@dataclass(frozen=True, eq=False)
class Match:
    """A way in which touches are landmarks.

    Attributes:
        landmark: (K,): which landmark each touch is; -1 for those that are none.
        matrix: (4, 4): frame of the touches from that of the landmarks.
        squares: sum of squared distances, mm^2.
    """

    landmark: NDArray[np.int64]
    matrix: Array
    squares: float

    @property
    def touched(self) -> int:
        """How many landmarks have a touch."""
        return len(np.unique(self.landmark[self.landmark >= 0]))

    @property
    def touches(self) -> int:
        """How many touches are at a landmark."""
        return int((self.landmark >= 0).sum())


def match_landmarks(
    touches_mm: Array, landmarks_mm: Array, tolerance_mm: float, *, in_order: bool = False, seed: int = 0
) -> list[Match]:
    """The ways in which touches (K, 3) fit landmarks (L, 3): most landmarks first, of these the closest first.

    Args:
        touches_mm: places, in the order touched.
        landmarks_mm: places in the phantom's frame, in the order listed.
        tolerance_mm: how far a touch may be from its landmark.
        in_order: they were touched in the order listed.
        seed: of the triples of landmarks, where these are too many for all.
    """
    seeds = [*_seeds(touches_mm, landmarks_mm, tolerance_mm, seed)]
    if not seeds:
        return []
    assigned = np.concatenate([_assigned(m, touches_mm, landmarks_mm, CARRIED * tolerance_mm) for m in seeds])
    if in_order:
        assigned = assigned[[_rises(row) for row in assigned]]
    counts = np.array([len(np.unique(row[row >= 0])) for row in np.unique(assigned, axis=0)])
    rows = np.unique(assigned, axis=0)[np.argsort(-counts, kind="stable")]
    found: dict[tuple[int, ...], Match] = {}
    for row in rows[:KEPT]:
        one = _settled(row, touches_mm, landmarks_mm, tolerance_mm)
        if one is not None and (not in_order or _rises(one.landmark)):
            found.setdefault(tuple(one.landmark.tolist()), one)
    ranked = sorted(found.values(), key=lambda one: (-one.touched, -one.touches, one.squares))
    return _distinct(ranked)


def _seeds(touches: Array, landmarks: Array, tolerance: float, seed: int) -> Iterator[Array]:
    """Motions (H, 4, 4) of three touches whose distances are those of three landmarks."""
    apart = np.linalg.norm(touches[:, None] - touches[None], axis=2)
    for triple in _triples(landmarks, seed):
        corners = landmarks[list(triple)]
        fits = [
            np.abs(apart - np.linalg.norm(corners[i] - corners[j])) <= 2 * tolerance
            for i, j in ((0, 1), (1, 2), (0, 2))
        ]
        i, j, k = np.nonzero(fits[0][:, :, None] & fits[1][None, :, :] & fits[2][:, None, :])
        if len(i):
            places = np.stack([touches[i], touches[j], touches[k]], axis=1)
            yield fitted_motions(np.broadcast_to(corners, places.shape), places)


def _triples(landmarks: Array, seed: int) -> list[tuple[int, ...]]:
    wide: list[tuple[int, ...]] = [
        one for one in combinations(range(len(landmarks)), 3) if _width(landmarks[list(one)]) > LEAST_WIDTH_MM
    ]
    if len(wide) <= MOST_TRIPLES:
        return wide
    chosen = np.random.default_rng(seed).choice(len(wide), MOST_TRIPLES, replace=False)
    return [wide[i] for i in chosen]


def _width(corners: Array) -> float:
    """The least height of a triangle."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).max()
    area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
    return float(area / sides) if sides > 0 else 0.0


def _assigned(matrices: Array, touches: Array, landmarks: Array, reach: float) -> NDArray[np.int64]:
    """(H, K): the landmark nearest to each touch, -1 where none is within reach."""
    there = landmarks @ np.swapaxes(matrices[:, :3, :3], 1, 2) + matrices[:, None, :3, 3]
    apart = np.linalg.norm(touches[None, :, None] - there[:, None], axis=3)
    return np.where(apart.min(axis=2) <= reach, apart.argmin(axis=2), -1)


def _settled(row: NDArray[np.int64], touches: Array, landmarks: Array, tolerance: float) -> Match | None:
    """The motion of an assignment, and the assignment that follows from it, until both rest."""
    matrix = np.eye(4)
    for _ in range(REFITS):
        on = row >= 0
        if len(np.unique(row[on])) < 3 or width_mm(landmarks[np.unique(row[on])]) <= LEAST_WIDTH_MM:
            return None
        matrix = fitted_motions(landmarks[row[on]], touches[on])
        before, row = row, _assigned(matrix[None], touches, landmarks, tolerance)[0]
        if np.array_equal(before, row):
            break
    on = row >= 0
    if len(np.unique(row[on])) < 3:
        return None
    left = landmarks[row[on]] @ matrix[:3, :3].T + matrix[:3, 3] - touches[on]
    return Match(row, matrix, float(np.sum(left**2)))


def width_mm(points: Array) -> float:
    """How far points are from one line, at most."""
    middle = points - points.mean(axis=0)
    along = np.linalg.svd(middle, full_matrices=False)[2][0]
    return float(np.linalg.norm(middle - np.outer(middle @ along, along), axis=1).max())


def _rises(row: NDArray[np.int64]) -> bool:
    return bool((np.diff(row[row >= 0]) >= 0).all())


def _distinct(ranked: list[Match]) -> list[Match]:
    """Those that say another landmark of some touch than all before them do."""
    kept: list[Match] = []
    for one in ranked:
        both = [(one.landmark >= 0) & (other.landmark >= 0) for other in kept]
        if not any(
            on.sum() >= 3 and np.array_equal(one.landmark[on], other.landmark[on])
            for on, other in zip(both, kept, strict=True)
        ):
            kept.append(one)
    return kept
