"""Where lines were a little earlier or later, by their places and velocities: what an unknown lag is fitted with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.observations.velocities import VELOCITY_COLUMNS, velocities_of
from sonocal.registration.rows import PointLineRows
from sonocal.setup_checks.lines_in_time import LONGEST_S, Moved, neighbours_noise, pieces_of
from sonocal.setup_checks.rows_in_time import RowsInTime, tracks_of

__all__ = ["MovingLines", "line_velocities", "moving_in_recording", "moving_in_table"]

# Of the parabolas that are fitted to a line's places: what tremor and noise do within it is no velocity.
WINDOW_S, ROUNDING = 0.3, 1e-3
# Of usual steps, in one that is bridged: however few sightings a track has, seconds count.
MOST_STEPS = 1e9
# How far from a place that is known a velocity that follows from the places may lead.
REACH_S = 0.05
# Where velocities lead to from one sighting and from the next, apart: noise of tracking is less.
TOGETHER_MM = 5.0


@dataclass(frozen=True, eq=False)
class MovingLines:
    """Places of lines with their velocities; between two of them a line is where both lead, each the more the nearer.

    Noise of a velocity has nothing in common with that of the place it is of, and what it has with the neighbours'
    cancels in between: where residuals follow such velocities no more, noise draws no lag anywhere.

    Attributes:
        axis: (M,), increasing: the times, tracks one after another.
        segments_mm: (M, 2, 3).
        velocities: (M, 2, 3), mm/s, of their ends.
        unrest: (M,): variance, along each axis, of the noise of a velocity, (mm/s)^2.
        origin: the time that the axis counts from.
        offset: of one track to the next one on it.
        reach_s: how far a place is carried.
    """

    axis: Array
    segments_mm: Array
    velocities: Array
    unrest: Array
    origin: float
    offset: float
    reach_s: float = REACH_S

    @classmethod
    def of(
        cls, track: NDArray[np.int64], time: Array, segments_mm: Array, velocities: Array | None = None
    ) -> Self:
        """Lines at known moments.

        Args:
            track: (M,): which needle each is a place of, counted from 0.
            time: (M,), s, finite; of places of a track at one time the first counts.
            segments_mm: (M, 2, 3), finite.
            velocities: (M, 2, 3), mm/s, where they are known; else they follow from the places.
        """
        span = float(np.ptp(time)) if len(time) else 0.0
        origin, offset = (float(time.min()) if len(time) else 0.0), 2.0 * span + 2.0 * LONGEST_S + 2.0
        axis = time - origin + track * offset
        order = np.lexsort((np.arange(len(axis)), axis))
        order = order[np.concatenate([[True], np.diff(axis[order]) > 0])] if len(order) else order
        axis, segments, track = axis[order], segments_mm[order], track[order]
        if velocities is not None:
            return cls(axis, segments, velocities[order], np.zeros(len(axis)), origin, offset)
        found, unrest = line_velocities(track, axis, segments)
        known = np.isfinite(unrest)
        return cls(axis[known], segments[known], found[known], unrest[known], origin, offset)

    def at(self, track: NDArray[np.int64], time: Array) -> Moved:
        """Where the lines of some tracks (N,) were at some times (N,)."""
        axis = time - self.origin + track * self.offset
        found = Moved.of(np.zeros(len(axis), dtype=bool))
        if not len(self.axis):
            return found
        after = np.clip(np.searchsorted(self.axis, axis), 0, len(self.axis) - 1)
        before = np.maximum(after - 1, 0)
        since, until = axis - self.axis[before], self.axis[after] - axis
        bridged = (since >= 0) & (until >= 0) & (since + until <= LONGEST_S)
        nearer = (np.abs(since) > np.abs(until)).astype(float)
        share = np.where(bridged, since / np.where(bridged & (since + until > 0), since + until, 1.0), nearer)
        found.usable[:] = bridged | (np.minimum(np.abs(since), np.abs(until)) <= self.reach_s)
        for node, gap, part in ((before, since, 1.0 - share), (after, -until, share)):
            carried = self.segments_mm[node] + gap[:, None, None] * self.velocities[node]
            found.spanning_mm[:] += part[:, None, None] * carried
            found.velocities[:] += part[:, None, None] * self.velocities[node]
            found.unrest[:] += part * self.unrest[node]
        return found


def line_velocities(track: NDArray[np.int64], axis: Array, segments_mm: Array) -> tuple[Array, Array]:
    """Velocities of lines' ends by a parabola through the places around each, and the variance of their noise.

    Args:
        track: (M,): which needle each is a place of.
        axis: (M,), s, increasing, tracks one after another.
        segments_mm: (M, 2, 3).

    Returns:
        (M, 2, 3), mm/s, and (M,), (mm/s)^2 along each axis; NaN where places are too few.

    Source: Savitzky and Golay 1964, for stamps that need not be even.
    """
    if not len(axis):
        return segments_mm, np.zeros(0)
    places = segments_mm.reshape(-1, 6)
    piece = pieces_of(axis, places, track, LONGEST_S, MOST_STEPS)
    step = np.diff(axis)[np.diff(piece) == 0]
    usual = float(np.median(step)) if len(step) else WINDOW_S
    each = max(round(0.5 * WINDOW_S / usual), 1)
    moments, sums = np.zeros((len(axis), 3, 3)), np.zeros((len(axis), 3, 6))
    for other in range(-each, each + 1):
        there = np.clip(np.arange(len(axis)) + other, 0, len(axis) - 1)
        since = (axis[there] - axis) / WINDOW_S
        near = (piece[there] == piece) & (there == np.arange(len(axis)) + other)
        near &= (np.abs(since) <= 0.5 + ROUNDING) | (abs(other) == 1)
        since = np.where(near, since, 0.0)
        powers = np.stack([near, since, since**2], axis=1).astype(float)
        moments += powers[:, :, None] * powers[:, None, :]
        sums += powers[:, :, None] * (places[there] - places)[:, None, :] * near[:, None, None]
    known = np.linalg.matrix_rank(moments, hermitian=True) == 3
    inverse = np.linalg.inv(np.where(known[:, None, None], moments, np.eye(3)))[:, 1] / WINDOW_S
    velocities = np.einsum("mk,mki->mi", inverse, sums).reshape(-1, 2, 3)
    noise = neighbours_noise(axis, places, piece)
    unrest = noise**2 * np.einsum("mj,mjk,mk->m", inverse, moments, inverse)
    return np.where(known[:, None, None], velocities, np.nan), np.where(known, unrest, np.nan)


def velocities_in_recording(times: Array, segments_mm: Array) -> Array:
    """(I, L, 2, 3), mm/s: of the ends of the lines (I, L, 2, 3) in every item of a recording; NaN where unknown."""
    found = np.full(segments_mm.shape, np.nan)
    items, needles = np.nonzero(np.isfinite(segments_mm).all(axis=(2, 3)))
    order = np.lexsort((times[items], needles))
    items, needles = items[order], needles[order]
    axis = times[items] - times.min() + needles * (2.0 * float(np.ptp(times)) + 1.0)
    if np.all(np.diff(axis) > 0):
        found[items, needles] = line_velocities(needles, axis, segments_mm[items, needles])[0]
    return found


def moving_in_recording(
    table: PointLineRows, times: Array, segments_mm: Array, frame: NDArray[np.int64], track: NDArray[np.int64]
) -> RowsInTime:
    """Sightings in a recording, whose every item says where its needles were; as `RowsInTime.in_recording`."""
    rows = RowsInTime.in_recording(table, times, segments_mm, frame, track)
    items, needles = np.nonzero(np.isfinite(segments_mm).all(axis=(2, 3)))
    return replace(
        rows, lines=MovingLines.of(needles, times[items] - times.min(), segments_mm[items, needles])
    )


def moving_in_table(observations: Observations, table: PointLineRows) -> RowsInTime:
    """A table's sightings in their order: by the velocities that it holds, by its times, or by both.

    Where both are there and go together, each line is where its neighbours in time lead; where they do not, as of rows
    that were drawn or sorted out, it is on the straight way from its own place.

    Raises:
        InputError: it holds neither, or a velocity is none.
    """
    velocities, stamps = velocities_of(observations), observations.stamps_s()
    segments, track = observations.segments_mm, tracks_of(observations, table)
    if velocities is None and stamps is None:
        raise InputError(
            f"{observations.source}: tells not when its rows were nor how their lines moved; a lag needs the column "
            f"time_s, or the lines' velocities {VELOCITY_COLUMNS[0]} ... {VELOCITY_COLUMNS[-1]}"
        )
    time = np.zeros(len(table)) if stamps is None else stamps - stamps.min()
    if velocities is None:
        return RowsInTime(table, MovingLines.of(track, time, segments), track, time, "s")
    if stamps is None or not _goes_together(track, time, segments, velocities):
        track, time = np.arange(len(table)), np.zeros(len(table))
    known = np.isfinite(velocities).all(axis=(1, 2))
    lines = MovingLines.of(track[known], time[known], segments[known], velocities[known])
    return RowsInTime(table, replace(lines, reach_s=LONGEST_S + REACH_S), track, time, "s")


def _goes_together(track: NDArray[np.int64], time: Array, segments_mm: Array, velocities: Array) -> bool:
    """Whether velocities lead from one sighting of a line to the next, but for some mm."""
    order = np.lexsort((time, track))
    order = order[np.isfinite(velocities[order]).all(axis=(1, 2))]
    before, after = order[:-1], order[1:]
    gap = time[after] - time[before]
    near = (track[after] == track[before]) & (gap > 0) & (gap <= LONGEST_S)
    half = 0.5 * gap[near, None, None]
    before, after = before[near], after[near]
    off = segments_mm[before] + half * velocities[before] - segments_mm[after] + half * velocities[after]
    return bool(near.any() and np.median(np.linalg.norm(off, axis=2)) < TOGETHER_MM)
