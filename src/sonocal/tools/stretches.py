"""What a tool did in a long recording: pivots, spins, touches and stillness, told apart by what of it rested.

A pose moves what is fixed to the marker: of a tool that lies still, all of it rests; of one that spins, a line; of one
that pivots, or touches, its tip. So windows of a few seconds are asked for a point that rests,

    R_i tip + t_i = pivot

and for an axis about which alone they turn. A tip is believed when a whole pivot bears it out; with it, each further
rest of it is a touch. What is left moved.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import SonocalError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.tools.pivot import PivotCalibration, calibrate_pivot
from sonocal.tools.poses import turns_deg
from sonocal.tools.rests import Rest, find_rests
from sonocal.tools.spin import SpinCalibration, calibrate_spin
from sonocal.tools.windows import Window, pivot_windows, spin_runs

__all__ = ["KINDS", "Stretch", "find_stretches"]

Kind = Literal["pivot", "spin", "touch", "still"]
KINDS: tuple[Kind, ...] = ("pivot", "spin", "touch", "still")
# A tool that turns less than that, rms about any axis, is held by no hand.
STILL_DEG = 0.5
# A tip is told by turns about two axes, rms about the one it turned least about, for so long; less is a touch.
PIVOT_DEG, PIVOT_S, PIVOT_RMS_MM = 8.0, 5.0, 2.0
TOUCH_S, LYING_S = 0.8, 1.2
# Of a rest, its own spread: so many times it is no other place.
AS_NEAR, LEAST_NEAR_MM = 2.5, 0.5
# Windows that agree within that are of one tip, mm.
ONE_TIP_MM = 6.0
MOST_TIPS = 3
# Of a stretch, the share that another one must not have already.
FREE = 0.5


@dataclass(frozen=True, eq=False)
class Stretch:
    """What a tool did, for a while.

    Attributes:
        tool: its marker.
        kind: "pivot", "spin", "touch" or "still".
        first, last: items of the recording that it begins and ends with.
        start_s, end_s: when.
        rows: items of it that count.
        found: the tip, the axis, the place where the tip rested; None of a tool that was still.
    """

    tool: str
    kind: Kind
    first: int
    last: int
    start_s: float
    end_s: float
    rows: NDArray[np.int64]
    found: PivotCalibration | SpinCalibration | Rest | None

    __repr__ = brief


def find_stretches(
    tool: str,
    reference_from_tool: Array,
    used: NDArray[np.bool_],
    times_s: Array,
    *,
    tip_mm: Array | None = None,
    seed: int = 0,
) -> list[Stretch]:
    """What a tool did, in the order in which it did.

    Args:
        tool: its marker.
        reference_from_tool: (N, 4, 4).
        used: (N,): poses that count.
        times_s: (N,), rising.
        tip_mm: (3,): its tip where it is known: touches need no pivot then.
        seed: of the random triples of poses of a pivot.
    """
    search = _Search(tool, reference_from_tool, used, times_s, seed)
    search.still()
    search.spins()
    tips = [*([] if tip_mm is None else [tip_mm]), *search.tips(tip_mm)]
    # Under a tip that is a little off a pivot falls into touches: every tip has its pivots first.
    for tip in tips:
        search.pivots_of(tip)
    for tip in tips:
        search.touches_of(tip)
    return sorted(search.found, key=lambda one: one.first)


class _Search:
    """The stretches of one tool as they are found: a pose belongs to one of them."""

    def __init__(
        self, tool: str, matrices: Array, used: NDArray[np.bool_], times_s: Array, seed: int
    ) -> None:
        self.tool, self.matrices, self.times, self.seed = tool, matrices, times_s, seed
        self.free = used.copy()
        self.used = used
        self.found: list[Stretch] = []

    def still(self) -> None:
        """Where the tool lay."""
        for rest in self._rests(np.zeros(3)):
            still = turns_deg(self.matrices[rest.rows, :3, :3])[2] < STILL_DEG
            rows = self._to_its_ends(rest, np.zeros(3))
            if still and self._lasts(rows) >= LYING_S:
                self._add("still", rows, None)

    def spins(self) -> None:
        """Where it turned about one axis alone, which rested."""
        for rows in spin_runs(self.matrices, self.free, self.times):
            try:
                spin = calibrate_spin(self.matrices[rows], source=self.tool)
            except SonocalError:
                continue
            self._add("spin", rows[spin.inlier], spin)

    def tips(self, known_mm: Array | None) -> Iterator[Array]:
        """Tips that pivots bear out, the most tilted first."""
        windows = [*pivot_windows(self.matrices, self.free, self.times)]
        tips = [] if known_mm is None else [known_mm]
        tried = 0
        while windows and tried < 3 * MOST_TIPS and len(tips) < MOST_TIPS:
            best = max(windows, key=lambda one: one.spread_deg)
            tip = self._borne_out(best)
            near = [best.tip_mm] if tip is None else [best.tip_mm, tip]
            if tip is not None and all(np.linalg.norm(tip - one) > ONE_TIP_MM for one in tips):
                tips.append(tip)
                yield tip
            windows = [
                one
                for one in windows
                if one is not best and all(np.linalg.norm(one.tip_mm - a) > ONE_TIP_MM for a in near)
            ]
            tried += 1

    def pivots_of(self, tip_mm: Array) -> None:
        """Where a tip rested while the tool was tilted to all sides."""
        for rest in self._rests(tip_mm):
            if (pivot := self._pivot(rest.rows)) is not None:
                self._add("pivot", rest.rows[pivot.inlier], pivot)

    def touches_of(self, tip_mm: Array) -> None:
        """Where else it rested."""
        for rest in self._rests(tip_mm):
            if self._lasts(rows := self._to_its_ends(rest, tip_mm)) >= TOUCH_S:
                # Of a tool that is put down for a moment everything rests, its tip, too.
                lay = turns_deg(self.matrices[rows, :3, :3])[2] < STILL_DEG
                self._add("still" if lay else "touch", rows, None if lay else rest)

    def _borne_out(self, window: Window) -> Array | None:
        """The tip of the whole pivot that a window is of."""
        middle = window.rows[len(window.rows) // 2]
        for rest in self._rests(window.tip_mm):
            if rest.first <= middle <= rest.last and (pivot := self._pivot(rest.rows)) is not None:
                return pivot.tip_mm
        return None

    def _pivot(self, rows: NDArray[np.int64]) -> PivotCalibration | None:
        """A pivot, if these poses make a sound one."""
        long = self.times[rows[-1]] - self.times[rows[0]] >= PIVOT_S
        if not long or turns_deg(self.matrices[rows, :3, :3])[0] < PIVOT_DEG:
            return None
        try:
            pivot = calibrate_pivot(self.matrices[rows], seed=self.seed, source=self.tool)
        except SonocalError:
            return None
        return pivot if pivot.rms_mm <= PIVOT_RMS_MM else None

    def _lasts(self, rows: NDArray[np.int64]) -> float:
        return float(self.times[rows[-1]] - self.times[rows[0]]) if len(rows) else 0.0

    def _to_its_ends(self, rest: Rest, place_mm: Array) -> NDArray[np.int64]:
        """The rows of a rest, and those beside them that are as near: means over its ends reach into what moves."""
        free = np.flatnonzero(self.free)
        off = np.linalg.norm(self._places(place_mm)[free] - rest.point_mm, axis=1)
        near = off <= max(AS_NEAR * rest.spread_mm, LEAST_NEAR_MM)
        low, high = np.searchsorted(free, [rest.first, rest.last + 1])
        while low > 0 and near[low - 1]:
            low -= 1
        while high < len(free) and near[high]:
            high += 1
        return np.asarray(free[low:high][near[low:high]])

    def _places(self, place_mm: Array) -> Array:
        """(N, 3): where a point of the tool is."""
        return np.asarray(self.matrices[:, :3, :3] @ place_mm + self.matrices[:, :3, 3])

    def _rests(self, place_mm: Array) -> list[Rest]:
        return find_rests(np.where(self.free[:, None], self._places(place_mm), np.nan), self.times)

    def _add(
        self, kind: Kind, rows: NDArray[np.int64], found: PivotCalibration | SpinCalibration | Rest | None
    ) -> None:
        if not len(rows) or self.free[rows].mean() < FREE:
            return
        first, last = int(rows[0]), int(rows[-1])
        start, end = float(self.times[first]), float(self.times[last])
        self.found.append(Stretch(self.tool, kind, first, last, start, end, rows, found))
        self.free[first : last + 1] = False
