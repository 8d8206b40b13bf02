"""Sightings of targets whose place is asked for, as the core takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal import _core
from sonocal.errors import InputError
from sonocal.geometry import Array, homogeneous_points, real_array
from sonocal.geometry.shown import brief

__all__ = ["SIGMA_MM", "SIGMA_PX", "UnplacedRows", "UnplacedTarget"]

KINDS = ("point", "line", "plane")
# What trackers and images have: a pose turns by 0.2 degrees where it shifts by 0.3 mm.
SIGMA_PX, SIGMA_MM = 1.0, 0.3
# Of what a rotation's columns have to do with one another.
ROUNDED = 1e-3
RAD_PER_MM = float(np.deg2rad(0.2) / SIGMA_MM)


@dataclass(frozen=True, eq=False)
class UnplacedTarget:
    """A point, a line or a plane that is fixed to something tracked, or in the room.

    Attributes:
        kind: "point", "line" or "plane".
        spanning_mm: (1, 3), (2, 3) or (3, 3): where it is in its frame, if that is known roughly; None: not at all.
        sigma_mm, sigma_deg: how well that is known, across it and of its direction; 0 and 0: exactly.
        body: a number for the tracked thing that it is fixed to, whose pose has noise too; None: the room.
    """

    kind: str
    spanning_mm: Array | None = None
    sigma_mm: float = 0.0
    sigma_deg: float = 0.0
    body: int | None = None

    __repr__ = brief

    @property
    def spans(self) -> int:
        """Points that span it: 1, 2, 3."""
        if self.kind not in KINDS:
            raise InputError(f"kind of a target is {self.kind!r}; give one of {', '.join(KINDS)}")
        return KINDS.index(self.kind) + 1

    @property
    def known(self) -> bool:
        """Whether its place is known exactly."""
        return self.spanning_mm is not None and self.sigma_mm == 0 and self.sigma_deg == 0


@dataclass(frozen=True, eq=False)
class UnplacedRows:
    """Rows of one frame together.

    Attributes:
        points: (N, 3), px.
        poses: (N, 3, 4): upper rows of the marker from the target's body, mm.
        group: (N,): the instant of each, from 0 on, never less than the one before.
        target: (N,): which of the targets.
        targets: what was seen.
        dimension: 2 or 3, of the source.
        order: (N,): where each row stood in what was given.
    """

    points: Array
    poses: Array
    group: NDArray[np.int32]
    target: NDArray[np.int32]
    targets: tuple[UnplacedTarget, ...]
    dimension: int
    order: NDArray[np.intp]

    __repr__ = brief

    @classmethod
    def of(
        cls,
        points: ArrayLike,
        poses: ArrayLike,
        targets: Sequence[UnplacedTarget],
        target: ArrayLike | None,
        frame: ArrayLike | None,
    ) -> UnplacedRows:
        """The rows that arrays hold, checked.

        Raises:
            InputError: shapes differ, or a target is not there.
        """
        given, matrices = real_array("points", points), real_array("marker_from_body", poses)
        if given.ndim != 2 or given.shape[1] not in {2, 3} or not len(given):
            raise InputError(f"points must have shape (N, 2) or (N, 3), px; got {given.shape}")
        count = len(given)
        if matrices.shape != (count, 4, 4):
            raise InputError(f"marker_from_body must have shape ({count}, 4, 4); got {matrices.shape}")
        which = np.zeros(count, int) if target is None else _codes("target", target, count)
        if not (targets and which.min() >= 0 and which.max() < len(targets)):
            raise InputError(
                f"target counts from 0 to {which.max()} and {len(targets)} are given; give each of them"
            )
        instant = np.arange(count) if frame is None else _codes("frame", frame, count)
        order = np.argsort(instant, kind="stable")
        return cls(
            np.ascontiguousarray(homogeneous_points(given)[order]),
            np.ascontiguousarray(_rigid(matrices)[order]),
            np.unique(instant[order], return_inverse=True)[1].astype(np.int32),
            which[order].astype(np.int32),
            tuple(targets),
            3 if given.shape[1] == 3 and given[:, 2].any() else 2,
            order,
        )

    def find(self, *, changes: Array | None = None, **how: Any) -> list[_core.FoundPlaces]:
        """Answers, the best first; with a lag where (N, 3, 4) derivatives of the bodies' poses of the marker are given.

        Raises:
            InputError: a number is not finite, or a pose not rigid.
        """
        try:
            return _core.find_places(
                self.points,
                self.poses,
                changes,
                self.group,
                self.target,
                *self._priors(),
                dimension=self.dimension,
                rad_per_mm=RAD_PER_MM,
                **how,
            )
        except ValueError as error:
            raise InputError(f"the sightings cannot be registered: {error}") from None

    def in_order(self, values: NDArray[Any]) -> NDArray[Any]:
        """(N,) of rows as they were given."""
        out = np.empty_like(values)
        out[self.order] = values
        return out

    def _priors(self) -> tuple[Any, ...]:
        count = len(self.targets)
        spanning, sigma_mm, sigma_rad = (
            np.zeros((count, 3, 3)),
            np.full(count, np.inf),
            np.full(count, np.inf),
        )
        for k, target in enumerate(self.targets):
            if target.spanning_mm is None:
                continue
            known = real_array(f"spanning_mm of target {k}", target.spanning_mm)
            if known.shape != (target.spans, 3):
                raise InputError(
                    f"spanning_mm of target {k}, a {target.kind}, must be ({target.spans}, 3); got {known.shape}"
                )
            spanning[k, : target.spans] = known
            sigma_mm[k], sigma_rad[k] = target.sigma_mm, np.deg2rad(target.sigma_deg)
        spans = np.array([target.spans for target in self.targets], dtype=np.int32)
        body = np.array([-1 if t.body is None else t.body for t in self.targets], dtype=np.int32)
        return spans, spanning, sigma_mm, sigma_rad, body


def _rigid(matrices: Array) -> Array:
    """(N, 3, 4): with the rotations nearest to those given, whose digits a file has rounded.

    Raises:
        InputError: one is none.
    """
    turned = matrices[:, :3, :3]
    if not np.isfinite(matrices).all():
        raise InputError("marker_from_body must be finite numbers; leave out rows without a pose")
    off = np.abs(np.swapaxes(turned, 1, 2) @ turned - np.eye(3)).reshape(len(turned), 9).max(axis=1)
    wrong = np.logical_or(off > ROUNDED, np.linalg.det(turned) < 0)
    if wrong.any():
        row = int(np.argmax(wrong))
        size = float(np.linalg.det(turned[row]))
        raise InputError(f"marker_from_body of row {row}: a pose is not rigid (det R = {size:.3g})")
    u, _, vt = np.linalg.svd(turned)
    return np.concatenate([u @ vt, matrices[:, :3, 3:]], axis=2)


def _codes(name: str, values: ArrayLike, count: int) -> NDArray[np.int64]:
    codes = np.asarray(values)
    if codes.shape != (count,) or codes.dtype.kind not in "iu":
        raise InputError(f"{name} must be {count} whole numbers, one a row; got {codes.dtype} {codes.shape}")
    return codes.astype(np.int64)
