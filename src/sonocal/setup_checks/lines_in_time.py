"""Where lines and other targets were at any moment, from where they were seen."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.observations import group_codes

__all__ = ["LONGEST_S", "LinesInTime", "Moved", "neighbours_noise", "pieces_of"]

# Stretches between sightings that are bridged: up to this many usual ones, and in seconds no longer than a hand
# keeps its course.
MOST_STEPS, LONGEST_S = 3.0, 0.4
# A cubic between two sightings leans on their neighbours.
LEAST_KNOTS = 4
NEWTON_STEPS = 3
# Root of the median of a standard normal variable's square.
MEDIAN_OF_SQUARES = 0.6745


@dataclass(frozen=True, eq=False)
class LinesInTime:
    """Segments as curves of time: cubic B-splines with the sightings as control points, in pieces without gaps.

    Such a curve does not pass through its points but smooths them, nearly alike wherever between them it is asked
    for. One that passes through them has all of their noise at the points and half of it midway: lags of half a frame
    would fit better than the true one. Time is such a curve, too: a steady motion stays one, whatever the stamps.

    Attributes:
        places: (C, 3 K), mm: control points, in order of track and time, each piece with one more at either end.
        moments: (C,): of the control points, tracks one after another on one axis.
        knot: (M,): where the curve's knots are among them.
        begins: (M,): the curve's moment at each knot.
        joined: (M,): whether the next knot is of the same piece.
        origin: the time that moments count from.
        offset: of one track's moments to the next one's.
        sigma_mm: noise of single sightings along each axis, as each one's neighbours tell; 0 where too few do.
    """

    places: Array
    moments: Array
    knot: NDArray[np.int64]
    begins: Array
    joined: NDArray[np.bool_]
    origin: float
    offset: float
    sigma_mm: float

    @classmethod
    def of(cls, track: NDArray[np.int64], time: Array, spanning_mm: Array, longest: float = np.inf) -> Self:
        """Curves through sightings.

        Args:
            track: (M,): which needle each is a sighting of, counted from 0.
            time: (M,), finite; of sightings of a track at one time the first counts.
            spanning_mm: (M, K, 3), finite.
            longest: stretch that is bridged, in units of time.
        """
        offset = 2.0 * float(np.ptp(time)) + 2.0 * LONGEST_S + 2.0 if len(time) else 1.0
        origin = float(time.min()) if len(time) else 0.0
        axis = time - origin + track * offset
        order = np.lexsort((np.arange(len(axis)), axis))
        order = order[np.concatenate([[True], np.diff(axis[order]) > 0])] if len(order) else order
        axis, places = axis[order], spanning_mm[order].reshape(len(order), -1)
        piece = pieces_of(axis, places, track[order], longest)
        kept = np.bincount(piece, minlength=1)[piece] >= LEAST_KNOTS
        axis, places, piece = axis[kept], places[kept], group_codes(piece[kept])
        sigma_mm = neighbours_noise(axis, places, piece)
        first = np.flatnonzero(np.diff(piece, prepend=-1))
        last = np.flatnonzero(np.diff(piece, append=-1))
        moments, places = (_with_ends(values, first, last) for values in (axis, places))
        knot = np.arange(len(axis)) + 2 * piece + 1
        begins = (moments[knot - 1] + 4.0 * moments[knot] + moments[knot + 1]) / 6.0
        joined = np.diff(piece, append=-1) == 0
        return cls(places, moments, knot, begins, joined, origin, offset, sigma_mm)

    def at(self, track: NDArray[np.int64], time: Array) -> Moved:
        """Where the lines of some tracks (N,) were at some times (N,)."""
        axis = time - self.origin + track * self.offset
        if not len(self.knot):
            return Moved.of(np.zeros(len(time), dtype=bool), self.places.shape[1] // 3)
        here = np.clip(np.searchsorted(self.begins, axis, side="right") - 1, 0, None)
        here -= (~self.joined[here]) & (self.begins[here] == axis)  # the very end of a piece
        known = (here >= 0) & (self.begins[here] <= axis) & self.joined[here]
        found = Moved.of(known, self.places.shape[1] // 3)
        usable = found.usable
        control = self.knot[here[usable], None] + np.arange(-1, 3)
        moments = self.moments[control]
        weights, rates = _weights(_solved(moments, axis[usable]))
        rates = _ratio(rates, np.einsum("nk,nk->n", rates, moments)[:, None])
        shape = found.spanning_mm[usable].shape
        found.spanning_mm[usable] = np.einsum("nk,nki->ni", weights, self.places[control]).reshape(shape)
        found.velocities[usable] = np.einsum("nk,nki->ni", rates, self.places[control]).reshape(shape)
        found.coupling[usable] = self.sigma_mm**2 * np.einsum("nk,nk->n", weights, rates)
        found.unrest[usable] = self.sigma_mm**2 * np.einsum("nk,nk->n", rates, rates)
        return found


@dataclass(frozen=True, eq=False)
class Moved:
    """Lines (N) at a moment each.

    Attributes:
        usable: (N,): whether they are known; else all is 0.
        spanning_mm: (N, K, 3): two ends of lines, three points of a mix.
        velocities: (N, K, 3), mm a unit of time, of these.
        coupling: (N,): covariance, along each axis, of a point's noise with that of its velocity. Both are made of the
            same sightings: it draws a lag to where between them the curve smooths most.
        unrest: (N,): variance, along each axis, of the noise of a point's velocity: it makes lags look surer than they
            are.
    """

    usable: NDArray[np.bool_]
    spanning_mm: Array
    velocities: Array
    coupling: Array
    unrest: Array

    @classmethod
    def of(cls, usable: NDArray[np.bool_], points: int = 2) -> Self:
        """With nothing filled in, of so many points each."""
        count = len(usable)
        places = np.zeros((count, points, 3))
        return cls(usable, places, places.copy(), np.zeros(count), np.zeros(count))

    def select(self, rows: NDArray[np.bool_]) -> Moved:
        """Some of them."""
        return Moved(**{one.name: getattr(self, one.name)[rows] for one in fields(self)})


def pieces_of(
    axis: Array, places: Array, track: NDArray[np.int64], longest: float, most_steps: float = MOST_STEPS
) -> NDArray[np.int64]:
    """(M,): which piece each sighting is of: a gap, another needle or an end for the other parts two."""
    if not len(axis):
        return np.zeros(0, dtype=np.int64)
    step, same = np.diff(axis), np.diff(track) == 0
    usual = float(np.median(step[same])) if same.any() else 0.0
    along = places[:, 3:6] - places[:, :3]  # of a point none, which does not turn round
    turned = np.einsum("ni,ni->n", along[1:], along[:-1]) < 0
    broken = ~same | turned | (step > min(most_steps * usual, longest))
    return np.concatenate([[0], np.cumsum(broken)])


def _with_ends(values: Array, first: NDArray[np.int64], last: NDArray[np.int64]) -> Array:
    """The values with one more before each piece and one after it, straight on: curves reach their ends."""
    before, after = 2 * values[first] - values[first + 1], 2 * values[last] - values[last - 1]
    return np.insert(values, np.concatenate([first, last + 1]), np.concatenate([before, after]), axis=0)


def neighbours_noise(axis: Array, places: Array, piece: NDArray[np.int64]) -> float:
    """Standard deviation along each axis of how far sightings are from the straight way between their neighbours."""
    inside = np.flatnonzero(piece[2:] == piece[:-2])
    if not len(inside):
        return 0.0
    part = ((axis[1:-1] - axis[:-2]) / (axis[2:] - axis[:-2]))[inside, None]
    off = places[1:-1][inside] - (1 - part) * places[:-2][inside] - part * places[2:][inside]
    share = 1.0 + (1 - part) ** 2 + part**2
    return float(np.sqrt(np.median(off**2 / share)) / MEDIAN_OF_SQUARES)


def _solved(moments: Array, axis: Array) -> Array:
    """(N,): the part of the way between two knots where a curve (N, 4) of time comes to a moment (N,)."""
    start, end = ((moments[:, i] + 4.0 * moments[:, i + 1] + moments[:, i + 2]) / 6.0 for i in (0, 1))
    part = _ratio(axis - start, end - start)
    for _ in range(NEWTON_STEPS):  # at even stamps the first guess is right
        weights, rates = _weights(part)
        off = np.einsum("nk,nk->n", weights, moments) - axis
        part = np.clip(part - _ratio(off, np.einsum("nk,nk->n", rates, moments)), 0.0, 1.0)
    return np.asarray(part)


def _ratio(above: Array, below: Array) -> Array:
    """Their ratio; 0 where stamps beyond all reason leave no rate."""
    return np.asarray(np.divide(above, below, out=np.zeros_like(above), where=below != 0))


def _weights(part: Array) -> tuple[Array, Array]:
    """(N, 4): of a cubic B-spline's control points, and their rates, a part (N,) of the way between two knots."""
    f, left = part, 1.0 - part
    weights = [left**3, 3 * f**3 - 6 * f**2 + 4, -3 * f**3 + 3 * f**2 + 3 * f + 1, f**3]
    rates = [-(left**2), 3 * f**2 - 4 * f, -3 * f**2 + 2 * f + 1, f**2]
    return np.stack(weights, axis=1) / 6.0, np.stack(rates, axis=1) / 2.0
