"""What was found in the images of a recording: one array for points of images and lines of volumes."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError
from sonocal.geometry import FURTHEST, Array
from sonocal.geometry.shown import brief

__all__ = ["Detections", "order_within"]

_DEFAULT: Any = None  # filled in by the constructor


@dataclass(frozen=True, eq=False)
class Detections:
    """Places in images that may be a needle, or are; all arrays have one entry a detection.

    A detection is one point (P = 1), a line given by two of its points (P = 2; in a volume a needle, in an image a
    wall), or a plane of a volume given by three (P = 3).

    Attributes:
        frame: (N,) index of the image in the recording.
        points_px: (N, P, D), in the MF-oriented image; D is 2 or 3.
        covariance_px2: (N, P, D, D), or None where unknown; of a line's or plane's points across it: along it a point
            means nothing.
        score: (N,): how far it stands out, greater is better; or None where others found it.
        rank: (N,): 0 for the best of its image, or of those of its line in it; default: in the order given.
        target: (N,) name of the line; "", the default, where it may be of any.
        images: how many images were looked at; default: those in which something was found.
        source: the name that messages give it.
        origin: (N,) who placed it, such as "moved", where somebody looked at each; or None.

    Raises:
        InputError: a shape does not fit, a value is not finite, a variance is not positive, or a detection stands
            twice.
    """

    frame: NDArray[np.int64]
    points_px: Array
    covariance_px2: Array | None = None
    score: Array | None = None
    rank: NDArray[np.int64] = field(default=_DEFAULT)
    target: NDArray[np.str_] = field(default=_DEFAULT)
    images: int = field(default=_DEFAULT)
    source: str = "detections"
    origin: NDArray[np.str_] | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        frame = np.asarray(self.frame)
        if frame.size and frame.dtype.kind not in "iu":
            raise InputError(f"{self.source}: frame must be whole numbers; got {frame.dtype}")
        self._set("frame", frame.astype(np.int64))
        self._set("points_px", np.asarray(self.points_px, dtype=float))
        for name in ("covariance_px2", "score"):
            if (column := getattr(self, name)) is not None:
                self._set(name, np.asarray(column, dtype=float))
        if frame.ndim != 1 or self.points_px.ndim != 3 or self.points_px.shape[0] != len(frame):
            raise InputError(
                f"{self.source}: needs frames (N,) and points_px (N, points, axes); "
                f"got {frame.shape} and {self.points_px.shape}"
            )
        self._set(
            "target", np.full(len(frame), "") if self.target is None else np.asarray(self.target, np.str_)
        )
        self._set("rank", self._order() if self.rank is None else np.asarray(self.rank, dtype=np.int64))
        if self.origin is not None:
            self._set("origin", np.asarray(self.origin, np.str_))
        self._set("images", len(np.unique(frame)) if self.images is None else self.images)
        self._check_shapes()
        self._check_values()

    @classmethod
    def of_points(
        cls,
        frame: ArrayLike,
        points_px: ArrayLike,
        target: str | Sequence[str] | NDArray[np.str_] = "",
        sigma_px: ArrayLike | None = None,
        source: str = "detections",
        *,
        origin: Sequence[str] | NDArray[np.str_] | None = None,
    ) -> Detections:
        """Points found by other means.

        Args:
            frame: (N,).
            points_px: (N, 2) or (N, 3).
            target: (N,) names of lines, or one for all.
            sigma_px: (N,) standard deviations along every axis, or one for all.
            source: what messages call them.
            origin: (N,) who placed each, or None.

        Raises:
            InputError: as the class.
        """
        points = np.asarray(points_px, dtype=float)
        if points.ndim != 2 or points.shape[1] not in (2, 3):
            raise InputError(f"{source}: points_px must have shape (N, 2) or (N, 3); got {points.shape}")
        covariance = None
        if sigma_px is not None:
            sigma = np.broadcast_to(np.asarray(sigma_px, dtype=float), len(points))
            if (row := _first(~((sigma > 0) & (sigma < FURTHEST)))) is not None:
                raise InputError(
                    f"{source}, row {row}, column sigma_px: {sigma[row]} is not a positive number below {FURTHEST:g}; "
                    "give a standard deviation, or drop the column"
                )
            covariance = (sigma**2)[:, None, None, None] * np.eye(points.shape[1])
        names = np.broadcast_to(np.asarray(target, dtype=np.str_), len(points))
        by = None if origin is None else np.asarray(origin, dtype=np.str_)
        return cls(np.asarray(frame), points[:, None], covariance, target=names, source=source, origin=by)

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def dimension(self) -> int:
        """2 for images, 3 for volumes."""
        return int(self.points_px.shape[2])

    @property
    def points_each(self) -> int:
        """1, or 2 for lines, or 3 for planes."""
        return int(self.points_px.shape[1])

    @property
    def sigma_px(self) -> Array | None:
        """(N, P): standard deviation of a coordinate, the mean over the directions that a detection fixes."""
        variance = self._variance_px2()
        return None if variance is None else np.sqrt(variance)

    def select(self, rows: ArrayLike) -> Detections:
        """Some of the detections, by a mask or indices; each keeps its rank."""
        index, part = np.asarray(rows), copy(self)  # some of sound detections are sound: no second check
        index = index if index.size else index.astype(np.int64)
        for name in ("frame", "points_px", "covariance_px2", "score", "rank", "target", "origin"):
            if (column := getattr(self, name)) is not None:
                part._set(name, column[index])
        return part

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _order(self) -> NDArray[np.int64]:
        """(N,): in the order given, among those of one image and name."""
        if self.target.shape != self.frame.shape:  # which is refused
            return np.zeros(len(self.frame), dtype=np.int64)
        names = np.unique(self.target, return_inverse=True)[1].reshape(-1)
        return order_within(
            np.unique(np.column_stack([self.frame, names]), axis=0, return_inverse=True)[1].reshape(-1)
        )

    def _variance_px2(self) -> Array | None:
        """(N, P)."""
        if self.covariance_px2 is None:
            return None
        fixed = self.dimension - (self.points_each - 1)
        return np.asarray(np.trace(self.covariance_px2, axis1=2, axis2=3) / fixed)

    def _check_shapes(self) -> None:
        count, points = len(self), self.points_px
        if points.shape[1:] not in ((1, 2), (1, 3), (2, 2), (2, 3), (3, 3)):
            raise InputError(
                f"{self.source}: a detection is one point, two points of a line, or in a volume three of a plane; "
                f"got {points.shape[1]} points of {points.shape[2]} coordinates"
            )
        shapes = {"covariance_px2": (*points.shape, points.shape[2]), "score": (count,)}
        for name, shape in {**shapes, "rank": (count,), "target": (count,), "origin": (count,)}.items():
            value = getattr(self, name)
            if value is not None and value.shape != shape:
                raise InputError(f"{self.source}: {name} must have shape {shape}; got {value.shape}")

    def _check_values(self) -> None:
        for axis, name in enumerate(("u_px", "v_px", "w_px")[: self.dimension]):
            values = self.points_px[:, :, axis]
            if (row := _first(~np.isfinite(values))) is not None:
                arrived = values[row][~np.isfinite(values[row])][0]
                raise InputError(
                    f"{self.source}, row {row}, column {name}: {arrived} is not a finite number; "
                    "leave out rows that were not seen"
                )
        variance = self._variance_px2()
        if variance is not None and (row := _first(~(np.isfinite(variance) & (variance > 0)))) is not None:
            raise InputError(
                f"{self.source}, row {row}: its covariance is not positive; give variances, or none at all"
            )
        if (pair := self._twice()) is not None:
            first, second = pair
            raise InputError(
                f"{self.source}, row {second}: repeats row {first} (frame {self.frame[first]}, target "
                f"{str(self.target[first])!r}) value for value; delete one, a copy is not a second measurement"
            )

    def _twice(self) -> tuple[int, int] | None:
        """Two detections that are one, the first by its second appearance."""
        names = np.unique(self.target, return_inverse=True)[1].reshape(-1)
        numbers = (
            np.column_stack(
                [self.frame, names, self.points_px.reshape(len(self), self.points_each * self.dimension)]
            )
            + 0.0
        )
        order = np.lexsort(numbers.T)
        same = (numbers[order[1:]] == numbers[order[:-1]]).all(axis=1)
        if not same.any():
            return None
        copies = np.flatnonzero(same)
        nearest = copies[np.argmin(order[1:][copies])]
        return int(order[nearest]), int(order[nearest + 1])


def order_within(frame: NDArray[Any]) -> NDArray[np.int64]:
    """(N,): how many of the same frame came before."""
    order = np.argsort(frame, kind="stable")
    ordered = frame[order]
    rank = np.empty(len(frame), dtype=np.int64)
    rank[order] = np.arange(len(frame)) - np.searchsorted(ordered, ordered, side="left")
    return rank


def _first(mask: NDArray[np.bool_]) -> int | None:
    """The first row in which something is True."""
    rows = np.flatnonzero(mask.any(axis=tuple(range(1, mask.ndim))))
    return int(rows[0]) if len(rows) else None
