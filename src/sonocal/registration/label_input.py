"""What a user gave of dots and wires, checked, and put in the order of frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array

__all__ = ["SearchLimits", "numbers", "sorted_by_frame"]

MOST_DOTS, MOST_WIRES = 255, 255


class SearchLimits(NamedTuple):
    """When a search ends.

    Attributes:
        finds: the best answer must be found so often.
        hypotheses: it is unfinished after so many.
        seconds: or after so long.
        seed: of what is drawn.
    """

    finds: int
    hypotheses: int
    seconds: float
    seed: int


def sorted_by_frame(
    dots: Array, wires: ArrayLike, frame: ArrayLike | None
) -> tuple[Array, NDArray[np.int32], Array, NDArray[np.int64]]:
    """Dots (N, ...) in the order of frames, where each frame's begin, wires (F, L, 2, 3), and where dots stood."""
    lines = np.asarray(wires, dtype=np.float64)
    if lines.ndim == 3:
        lines = lines[None]
    if lines.ndim != 4 or lines.shape[2:] != (2, 3) or 0 in lines.shape:
        raise InputError(f"lines must be (L, 2, 3) or (F, L, 2, 3) mm, two points on each; got {lines.shape}")
    if not np.isfinite(lines).all():
        raise InputError("lines holds a number that is not finite; leave out frames without a pose")
    if (lines[:, :, 0] == lines[:, :, 1]).all(axis=-1).any():
        raise InputError("lines holds one whose two points are one; give two places on each")
    number = np.zeros(len(dots), dtype=np.int64) if frame is None else np.asarray(frame)
    if number.shape != (len(dots),) or number.dtype.kind not in "iu":
        raise InputError(
            f"frame must be {len(dots)} whole numbers, one a point; got {number.dtype} {number.shape}"
        )
    if len(number) and not (number.min() >= 0 and number.max() < len(lines)):
        raise InputError(
            f"frame must be between 0 and {len(lines) - 1}, as lines are of {len(lines)} frames; got "
            f"{number.min()} to {number.max()}"
        )
    counts = np.bincount(number, minlength=len(lines))
    if counts.max(initial=0) > MOST_DOTS or lines.shape[1] > MOST_WIRES:
        raise InputError(
            f"a frame may have {MOST_DOTS} points and {MOST_WIRES} lines at the most; got {counts.max(initial=0)} "
            f"and {lines.shape[1]}: keep the brightest points"
        )
    order = np.argsort(number, kind="stable")
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return np.ascontiguousarray(dots[order]), first, np.ascontiguousarray(lines), order


def numbers(name: str, given: ArrayLike, shape: tuple[int, ...], words: str) -> Array:
    """An array (N, *shape) of finite numbers, or a refusal that calls it by its name."""
    array = np.asarray(given, dtype=np.float64)
    if array.ndim != 1 + len(shape) or array.shape[1:] != shape:
        raise InputError(f"{name} must be {words}; got shape {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds a number that is not finite; leave out what was not found")
    return array
