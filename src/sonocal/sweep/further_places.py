"""Where further targets are, once a calibration is roughly known: consensus over what may be one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sonocal.detection import Detections
from sonocal.errors import NoConsensusError
from sonocal.geometry import Array, AxisScaled
from sonocal.geometry.shown import brief
from sonocal.recording import Recording
from sonocal.sweep.chance import away_mm, enough_images, may_be_chance
from sonocal.sweep.options import PointsOptions
from sonocal.sweep.own_places import threshold_of
from sonocal.targets import Target, Unplaced
from sonocal.targets.unplaced import KINDS

__all__ = ["Seen", "further_place"]

PLACES = 3000
"""Tried of a line or plane, at the most."""
CHUNK = 100
CLOSE_MM = 2.0
ROUNDS = 5
LATER = (0.2, 0.4, 0.6, 0.8)
FREE = {"point": 1, "line": 2, "plane": 3}
"""A place alone can be led through what any so many images show."""


@dataclass(frozen=True, eq=False)
class Seen:
    """What may be a target, in that target's frame.

    Attributes:
        points_mm: (C, P, 3): of each candidate.
        frame: (C,): its image; ascending.
        number: (C,): among the detections.
    """

    points_mm: Array
    frame: NDArray[np.int64]
    number: NDArray[np.int64]

    __repr__ = brief

    @classmethod
    def of(
        cls,
        recording: Recording,
        target: Target | Unplaced,
        detections: Detections,
        transform: AxisScaled,
        options: PointsOptions,
        *,
        later: float = 0.0,
    ) -> Self:
        """Detections that have a pose, as a calibration carries them into the frame of a target.

        With `later`, as the poses of other images would: those so large a share of the recording later.
        """
        poses = recording.between(target.frame, options.probe, options.fixed, options.on_invalid).matrices
        posed = np.isfinite(poses[detections.frame]).all(axis=(1, 2))
        if len(recording.frames):
            posed &= recording.image_valid[detections.frame]
        number = np.flatnonzero(posed)
        number = number[np.argsort(detections.frame[number], kind="stable")]
        frame, points = detections.frame[number], detections.points_px[number]
        known = np.unique(frame)
        turn = round(later * len(known))
        poses = poses[known[(np.searchsorted(known, frame) + turn) % max(len(known), 1)]]
        flat = transform @ points.reshape(-1, detections.dimension)
        there = flat.reshape(*points.shape[:2], 3) @ np.swapaxes(poses[:, :3, :3], 1, 2)
        return cls(there + poses[:, None, :3, 3], frame, number)

    def away(self, spanning_mm: Array) -> Array:
        """(..., C): how far the furthest point of each candidate is from what (..., K, 3) spans."""
        away = [
            away_mm(self.points_mm[:, i], spanning_mm[..., None, :, :])
            for i in range(self.points_mm.shape[1])
        ]
        return np.asarray(np.max(away, axis=0))

    def nearest(self, spanning_mm: Array, within_mm: float) -> NDArray[np.int64]:
        """Of each image the candidate that is nearest, where it is near."""
        away = self.away(spanning_mm)
        order = np.lexsort((away, self.frame))
        best = order[np.unique(self.frame[order], return_index=True)[1]]
        return np.asarray(best[away[best] <= within_mm])


def further_place(
    recording: Recording,
    target: Unplaced,
    detections: Detections,
    transform: AxisScaled,
    options: PointsOptions,
) -> tuple[Array, NDArray[np.int64]]:
    """The place of a target that most images agree on, or that next to where it was said to be.

    Args:
        recording: with any lag undone.
        target: whose place is asked for.
        detections: that are no other target's.
        transform: roughly the calibration.
        options: how.

    Returns:
        (K, 3), mm: points that span it in its frame, and which detections are of it.

    Raises:
        NoConsensusError: so few images agree on a place that it may be chance.
    """
    seen, *elsewhere = (
        Seen.of(recording, target, detections, transform, options, later=later) for later in (0.0, *LATER)
    )
    most, random = threshold_of(options), np.random.default_rng(options.seed)
    agreed = 0
    said = target.spanning_mm
    tried = _places(target.kind, seen, random) if said is None else np.array(said)[None]
    if len(tried):
        for within_mm in (min(CLOSE_MM, most), most):
            place = _settled(target.kind, seen, tried[np.argmax(_worth(seen, tried, within_mm))], within_mm)
            mine = seen.nearest(place, within_mm)
            agreed = max(agreed, len(mine))
            by_chance = _by_chance(elsewhere, place, within_mm)
            if not may_be_chance(len(mine), detections.images, by_chance, FREE[target.kind]):
                return place, seen.number[mine]
    raise NoConsensusError(
        f"{recording.name}: no place of the {target.kind} {target.name!r} agrees with more than {agreed} of "
        f"{detections.images} images, beside the other targets, where {enough_images(detections.images):.0f} are "
        "needed and more than by chance; take it out of the file of targets, or check in the contact sheet that it is "
        "visible and marked",
        best_count=agreed,
    )


def _places(kind: str, seen: Seen, random: np.random.Generator) -> Array:
    """(H, K, 3): places that some candidates agree on exactly."""
    spans, each, count = KINDS.index(kind) + 1, seen.points_mm.shape[1], len(seen.frame)
    if spans <= each:
        return seen.points_mm[:, :spans]
    if count < 2:
        return np.zeros((0, spans, 3))
    first = random.integers(count, size=PLACES)
    others = random.integers(count, size=(PLACES, spans - each))
    frames = np.column_stack([seen.frame[first], seen.frame[others]])
    apart = [len(set(row)) == len(row) for row in frames.tolist()]
    points = np.concatenate([seen.points_mm[first], seen.points_mm[others, 0]], axis=1)[apart]
    sides = points[:, 1:] - points[:, :1]
    # Points that are too near one another, or in a row, span nothing.
    size = (
        np.linalg.norm(sides[:, 0], axis=1)
        if spans == 2
        else np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    )
    return np.asarray(points[size > 1.0])


def _worth(seen: Seen, places: Array, within_mm: float) -> Array:
    """(H,): of each place, its images' sum of how near it is to what is nearest, 1 to 0 at the threshold."""
    starts = np.unique(seen.frame, return_index=True)[1]
    worth = [
        np.maximum.reduceat(
            np.clip(1 - (seen.away(places[i : i + CHUNK]) / within_mm) ** 2, 0, None), starts, axis=1
        ).sum(axis=1)
        for i in range(0, len(places), CHUNK)
    ]
    return np.concatenate(worth)


def _settled(kind: str, seen: Seen, place: Array, within_mm: float) -> Array:
    """The place that fits what is near it, in least squares, until that no longer changes much."""
    spans = len(place)
    for _ in range(ROUNDS):
        points = seen.points_mm[seen.nearest(place, within_mm)].reshape(-1, 3)
        if len(points) < spans:
            break
        middle = points.mean(axis=0)
        along = np.linalg.svd(points - middle, full_matrices=True)[2]
        reach = float(np.abs((points - middle) @ along[0]).max()) + 1.0
        place = np.vstack([middle, *(middle + reach * along[i] for i in range(spans - 1))])
    return place


def _by_chance(elsewhere: Sequence[Seen], place: Array, within_mm: float) -> float:
    """Images that agree when points of an image are taken for those of others."""
    return float(np.mean([len(one.nearest(place, within_mm)) for one in elsewhere]))
