"""Where to hold the needle next: the pose of those in reach that is expected to tell most (D-optimal).

    argmax over poses of  log det(I + C J' J / sigma^2),      C the covariance so far, J of a sighting's distances

A hand misses what it is told, by some px and some degrees: what a pose tells is the mean over where it may end, and
nothing where that is outside of the image. So the places asked for keep off the edges by themselves.

Source: Fedorov, Theory of Optimal Experiments, 1972 (one pose at a time).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration
from sonocal.errors import InputError, UnsupportedError, require
from sonocal.geometry import Array, AxisScaled, Similarity
from sonocal.geometry.shown import brief
from sonocal.registration.uncertainty import point_jacobian
from sonocal.sweep.hold import Hold, held

__all__ = ["Reach", "first_holds", "holds_met", "next_holds"]

PLACES, AROUND = 9, 16
"""Along each side of the image, and about its normal."""
TILTS = (0.0, 0.5, 1.0)
"""Of the greatest."""
NODES, WEIGHTS = np.array([-1.0, 0.0, 1.0]) * np.sqrt(3.0), np.array([1.0, 4.0, 1.0]) / 6
"""Gauss and Hermite's: the mean over a normal deviate."""
NOTHING_KNOWN = 1e-6
"""Information of every motion, of lengths in images' widths, before the first sighting."""
MEETS = 2.5
"""Of how far hands miss: from within it a pose counts as held."""


@dataclass(frozen=True, eq=False)
class Reach:
    """Poses that a hand can hold, and how well it does.

    Attributes:
        most_tilt_deg: of the needle from the image's normal, 5 to 80.
        miss_px: standard deviation of where the needle crosses from where it was to.
        miss_deg: of its tilt.
        side: of the image on which the needle's hub is: 1 where w > 0, else -1.
        mask: (rows, columns): where the image shows anything; None: everywhere.

    Raises:
        InputError: a number means nothing.
    """

    most_tilt_deg: float = 60.0
    miss_px: float = 25.0
    miss_deg: float = 10.0
    side: int = 1
    mask: NDArray[np.bool_] | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        if not 5.0 <= self.most_tilt_deg <= 80.0:
            raise InputError(f"most_tilt_deg must be from 5 to 80 degrees; got {self.most_tilt_deg}")
        if not (0 <= self.miss_px < np.inf and 0 <= self.miss_deg <= 45):
            raise InputError(
                f"a hand misses by 0 px or more and 0 to 45 degrees; got {self.miss_px} px and {self.miss_deg}"
            )
        if self.side not in (1, -1):
            raise InputError(f"side must be 1 or -1; got {self.side}")
        if self.mask is not None and (self.mask.ndim != 2 or not self.mask.any()):
            raise InputError("mask must be (rows, columns) with some pixels that are True")


def next_holds(found: Calibration, *, count: int = 1, reach: Reach | None = None) -> tuple[Hold, ...]:
    """The poses to hold next, best first, each as if those before it had been held.

    Args:
        found: the calibration so far, of a 2D probe.
        count: how many.
        reach: which poses can be held; up to 60 degrees anywhere in the image unless told.

    Raises:
        UnsupportedError: it is of a 3D probe, which sees the whole needle, or has no covariance.
        InputError: an argument means nothing.
    """
    require("found", found, Calibration)
    if found.dimension != 2:
        raise UnsupportedError("a volume shows the whole needle; there is no pose to ask for: keep it moving")
    if found.covariance is None or not np.isfinite(found.noise.row_mm):
        raise UnsupportedError(
            "this calibration has no row to spare, so nothing tells what is missing; scan on"
        )
    low, high = found.area_px
    size = found.image_size_px or tuple(int(side) for side in np.ceil(high) + 1)
    poses = _Poses.of((size[0], size[1]), reach or Reach(), low)
    informations = poses.informations(found.probe_from_image, len(found.covariance))
    informations /= max(found.noise.row_mm, 1e-6) ** 2
    scale = float(found.probe_from_image.scales[:2].mean())
    known = np.asarray(np.linalg.pinv(found.covariance, hermitian=True), dtype=float)
    chosen = _best(known, informations, _checked(count))
    return tuple(poses.hold(k, scale) for k in chosen)


def first_holds(
    image_size_px: tuple[int, int], *, count: int = 1, reach: Reach | None = None
) -> tuple[Hold, ...]:
    """The poses to begin with, when nothing is known yet; they need no calibration.

    Raises:
        InputError: an argument means nothing.
    """
    if len(image_size_px) != 2 or min(image_size_px) < 2:
        raise InputError(f"image_size_px must be (width, height) of an image; got {image_size_px!r}")
    reach = reach or Reach()
    poses = _Poses.of(image_size_px, reach)
    chosen = _beginning(image_size_px, reach, _checked(count))
    return tuple(poses.hold(k) for k in chosen)


def holds_met(holds: tuple[Hold, ...], probe_from_image: AxisScaled, segments_mm: Array, reach: Reach) -> int:
    """How many of the poses, in their order, a needle (N, 2, 3), mm in the probe's frame, was held in.

    Args:
        holds: that were asked for.
        probe_from_image: mm from px.
        segments_mm: one a time; NaN where it was lost.
        reach: how far hands miss: a pose counts from within that.
    """
    require("reach", reach, Reach)
    done = 0
    for segment in segments_mm:
        if done == len(holds):
            break
        now = held(probe_from_image, segment, holds[done].image_size_px)
        if now is None:
            continue
        px, degrees = holds[done].misses(now)
        done += px <= MEETS * reach.miss_px and degrees <= MEETS * reach.miss_deg
    return done


@dataclass(frozen=True, eq=False)
class _Poses:
    """All that can be asked for: places (N, 2) px, tilts and directions (N,) degrees."""

    size_px: tuple[int, int]
    reach: Reach
    places_px: Array
    tilt_deg: Array
    around_deg: Array

    @classmethod
    def of(cls, size_px: tuple[int, int], reach: Reach, low: Array | None = None) -> _Poses:
        """Every place with every tilt."""
        begin = np.zeros(2) if low is None else low
        u, v = (np.linspace(first, side - 1, PLACES) for first, side in zip(begin, size_px, strict=True))
        places = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        around = np.arange(AROUND) * 360.0 / AROUND
        leans = [(0.0, 0.0)] + [(t * reach.most_tilt_deg, a) for t in TILTS if t for a in around]
        tilt, turn = np.array(leans).T
        return cls(
            size_px,
            reach,
            np.repeat(places, len(tilt), axis=0),
            np.tile(tilt, len(places)),
            np.tile(turn, len(places)),
        )

    def hold(self, k: int, scale_mm_per_px: float | None = None) -> Hold:
        """One of them."""
        u, v = self.places_px[k].tolist()
        lean = float(self.tilt_deg[k]), float(self.around_deg[k])
        return Hold((u, v), *lean, self.reach.side, self.size_px, scale_mm_per_px)

    def informations(self, transform: AxisScaled, parameters: int) -> Array:
        """(N, k, k): what a sighting of each tells, at a standard deviation of 1 mm, where a hand may end."""
        tilt, around = np.radians(self.tilt_deg), np.radians(self.around_deg)
        # Seen from the image: it does not matter where the hub is, a line has no sign.
        side = self.reach.side * np.cos(tilt)
        needles = np.column_stack([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), side])
        along = needles[:, :, None] * needles[:, None, :]
        spread = np.radians(self.reach.miss_deg) ** 2
        across = (1 - spread) * (np.eye(3) - along) + 2 * spread * along  # its mean, to first order
        rotation = transform.rotation
        across = rotation @ across @ rotation.T
        total = np.zeros((len(tilt), parameters, parameters))
        for places, weight, seen in self._ends():
            jacobian = point_jacobian(transform, places, parameters)
            total += (weight * seen)[:, None, None] * (np.swapaxes(jacobian, 1, 2) @ across @ jacobian)
        return total

    def _ends(self) -> Iterator[tuple[Array, float, NDArray[np.bool_]]]:
        """Where a hand may end, how likely, and whether the image shows it."""
        width, height = self.size_px
        for du, first in zip(NODES, WEIGHTS, strict=True):
            for dv, second in zip(NODES, WEIGHTS, strict=True):
                places = self.places_px + self.reach.miss_px * np.array([du, dv])
                inside = np.all((places >= 0) & (places <= [width - 1, height - 1]), axis=1)
                if (mask := self.reach.mask) is not None:
                    rows, columns = (
                        np.clip(places[:, i].round().astype(int), 0, mask.shape[1 - i] - 1) for i in (1, 0)
                    )
                    inside = inside & mask[rows, columns]
                yield places, float(first * second), inside


def _best(information: Array, offered: Array, count: int) -> list[int]:
    """Which of (N, k, k) to take, one after the other."""
    chosen = []
    for _ in range(count):
        covariance = np.linalg.inv(information)
        gains = np.linalg.slogdet(np.eye(len(information)) + covariance @ offered)[1]
        chosen.append(int(np.argmax(gains)))
        information = information + offered[chosen[-1]]
    return chosen


def _beginning(size_px: tuple[int, int], reach: Reach, count: int) -> list[int]:
    if reach.mask is None:
        return _usual(size_px, reach.most_tilt_deg, reach.miss_px, reach.miss_deg, count)
    return _from_nothing(size_px, reach, count)


@lru_cache(maxsize=32)
def _usual(size_px: tuple[int, int], tilt: float, miss_px: float, miss_deg: float, count: int) -> list[int]:
    return _from_nothing(size_px, Reach(tilt, miss_px, miss_deg), count)


def _from_nothing(size_px: tuple[int, int], reach: Reach, count: int) -> list[int]:
    transform = Similarity(np.eye(3), np.zeros(3), 1.0 / max(size_px))
    offered = _Poses.of(size_px, reach).informations(transform, 7)
    return _best(NOTHING_KNOWN * np.eye(7), offered, count)


def _checked(count: Any) -> int:
    if not isinstance(count, int) or not 1 <= count <= 1000:
        raise InputError(f"count must be a whole number from 1 to 1000; got {count!r}")
    return count
