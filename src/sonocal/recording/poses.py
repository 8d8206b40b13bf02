"""Poses of tracked tools, with which of them hold."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = [
    "FROZEN_RUN",
    "RIGID_TOLERANCE",
    "Mask",
    "OnInvalid",
    "Poses",
    "by_name",
    "determinant",
    "is_transposed",
    "longest_run",
    "repeated",
    "rigidity_error",
    "travel_mm",
]

Mask = NDArray[np.bool_]
OnInvalid = Literal["raise", "skip"]

# Files hold matrices rounded to four digits or more; what is further from a rotation is no pose.
RIGID_TOLERANCE = 5e-3
# Poses equal to the last digit for this long are a tracker that repeats itself, not a hand that is still.
FROZEN_RUN = 10


@dataclass(frozen=True, eq=False)
class Poses:
    """One tracked tool: ``target_from_source``, one 4 x 4 matrix an item of the recording.

    Attributes:
        source: what is tracked, such as "Probe".
        target: in whose frame, such as "Tracker".
        matrices: (N, 4, 4); NaN where the file has no pose.
        valid: (N,): the tracker vouches for it (status OK) and every number is finite.
        status: (N,) the status as the file spells it, None where it has none.
    """

    source: str
    target: str
    matrices: Array
    valid: Mask
    status: tuple[str | None, ...] | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        if self.matrices.ndim != 3 or self.matrices.shape[1:] != (4, 4):
            raise InputError(f"{self.name}: poses must have shape (N, 4, 4); got {self.matrices.shape}")
        if self.valid.shape != (len(self.matrices),):
            raise InputError(
                f"{self.name}: valid must have shape ({len(self.matrices)},); got {self.valid.shape}"
            )

    @classmethod
    def of(cls, source: str, target: str, matrices: ArrayLike) -> Poses:
        """Poses of which every finite one is valid."""
        array = np.asarray(matrices, dtype=float)
        return cls(source, target, array, np.isfinite(array).all(axis=(-2, -1)))

    @property
    def name(self) -> str:
        """Such as ``tracker_from_probe``."""
        return f"{_snake(self.target)}_from_{_snake(self.source)}"

    @property
    def plus_name(self) -> str:
        """Such as ``ProbeToTracker``."""
        return f"{self.source}To{self.target}"

    def __len__(self) -> int:
        return len(self.matrices)

    def inverse(self) -> Poses:
        """``source_from_target``."""
        return Poses(self.target, self.source, _inverted(self.matrices, self.valid), self.valid)

    def select(self, rows: ArrayLike) -> Poses:
        """The poses of some items."""
        index = chosen(len(self), rows)
        status = None if self.status is None else tuple(self.status[i] for i in index)
        return replace(self, matrices=self.matrices[index], valid=self.valid[index], status=status)

    def usable(self, source: str, on_invalid: OnInvalid = "raise") -> Poses:
        """The poses with those that are not rigid refused or, with "skip", marked invalid.

        Args:
            source: the recording's name, for the message.
            on_invalid: "raise" or "skip".

        Raises:
            InputError: a valid pose is not rigid.
        """
        bad = self.valid & ~(rigidity_error(self.matrices) <= RIGID_TOLERANCE)
        if on_invalid == "raise" and bad.any():
            frame = int(np.flatnonzero(bad)[0])
            if is_transposed(self.matrices[frame]):
                raise InputError(
                    f"{source}, frame {frame}: {self.plus_name} is transposed: its place stands in the last row; write "
                    "matrices row by row, with the place in the last column"
                )
            raise InputError(
                f"{source}, frame {frame}: {self.plus_name} is not rigid "
                f"(det R = {determinant(self.matrices[frame]):.3g}); "
                "drop such frames with --on-invalid skip"
            )
        return replace(self, valid=self.valid & ~bad)


def chosen(count: int, rows: ArrayLike) -> NDArray[np.int64]:
    """Indices of the rows, of so many, that a mask, a slice's range or indices choose; none of them is a choice."""
    indices = np.asarray(rows, dtype=None if np.size(rows) else np.int64)
    return np.asarray(np.arange(count)[indices])


def by_name(poses: Iterable[Poses], name: str) -> dict[str, Poses]:
    """Poses by their name.

    Raises:
        InputError: two transforms differ only in spelling.
    """
    found: dict[str, Poses] = {}
    for one in poses:
        if one.name in found:
            raise InputError(
                f"{name}: {found[one.name].plus_name} and {one.plus_name} are one transform twice; rename one"
            )
        found[one.name] = one
    return found


def rigidity_error(matrices: ArrayLike) -> Array:
    """(...): how far matrices (..., 4, 4) are from rigid; NaN for those that are not finite.

    The largest entry of ``|R^T R - I|`` and of the last row's difference from 0 0 0 1; a mirroring
    matrix gives infinity.
    """
    array = np.asarray(matrices, dtype=float)
    rotation = array[..., :3, :3]
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        error = np.abs(np.swapaxes(rotation, -1, -2) @ rotation - np.eye(3)).max(axis=(-2, -1), initial=0.0)
        error = np.maximum(error, np.abs(array[..., 3, :] - [0, 0, 0, 1]).max(axis=-1, initial=0.0))
        mirrored = np.linalg.det(np.where(np.isfinite(rotation), rotation, 0.0)) < 0
    return np.asarray(np.where(mirrored & np.isfinite(error), np.inf, error))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def determinant(matrix: Array) -> float:
    """Of the rotation in a pose (4, 4), for messages: what is no pose may have numbers of any size."""
    return float(np.linalg.det(matrix[:3, :3]))


@np.errstate(over="ignore")
def travel_mm(matrices: Array) -> float:
    """The largest distance of poses (N, 4, 4) from their median place."""
    if len(matrices) == 0:
        return 0.0
    places = matrices[:, :3, 3]
    return float(np.linalg.norm(places - np.median(places, axis=0), axis=1).max())


def is_transposed(matrix: Array) -> bool:
    """Whether a matrix (4, 4) that is not rigid is rigid when rows and columns are exchanged."""
    return bool(rigidity_error(matrix.T) <= RIGID_TOLERANCE < rigidity_error(matrix))


def _inverted(matrices: Array, valid: Mask) -> Array:
    # The general inverse, not the transpose: files round rotations, and a chain should undo what they state.
    inverse = np.full_like(matrices, np.nan)
    inverse[valid] = np.linalg.inv(matrices[valid])
    return inverse


def _snake(name: str) -> str:
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    return re.sub(r"\W+", "_", words).lower()


UNIT_TOLERANCE = 1e-2


def poses_from_quaternions(
    quaternions_wxyz: Array, places_mm: Array, source: str, target: str, where: str
) -> Poses:
    """Poses from quaternions and places; rows with a NaN are invalid, and so is a quaternion of zeros: none was seen.

    Raises:
        InputError: a quaternion is far from unit length: its columns are probably not what they say.
    """
    valid = np.asarray(np.isfinite(quaternions_wxyz).all(axis=1) & np.isfinite(places_mm).all(axis=1))
    with np.errstate(over="ignore"):
        length = np.linalg.norm(quaternions_wxyz, axis=1)
    valid &= length > 0
    off = valid & ~(np.abs(length - 1) <= UNIT_TOLERANCE)
    if off.any():
        row = int(np.flatnonzero(off)[0])
        raise InputError(
            f"{where}, row {row}: the quaternion of {source} has length {length[row]:.3g} where 1 is due; "
            "check the order of its columns"
        )
    matrices = np.full((len(valid), 4, 4), np.nan)
    matrices[valid] = np.eye(4)
    if valid.any():
        matrices[valid, :3, :3] = _rotations(quaternions_wxyz[valid] / length[valid, None])
        matrices[valid, :3, 3] = places_mm[valid]
    return Poses(source, target, matrices, valid)


def _rotations(unit_wxyz: Array) -> Array:
    """(N, 3, 3) of unit quaternions (N, 4); written out, since importing SciPy takes longer than reading most files."""
    w, x, y, z = unit_wxyz.T
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def repeated(matrices: Array) -> Mask:
    """(N,): whether a pose (N, 4, 4) is one that came before, to the last digit: no measurement of its own."""
    first = np.unique(matrices.reshape(-1, 16), axis=0, return_index=True)[1]
    again = np.ones(len(matrices), dtype=bool)
    again[first] = False
    return again


def longest_run(mask: Mask) -> int:
    """How often in a row, at most, a mask (N,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))
