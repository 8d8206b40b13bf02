"""Poses and images of messages, whatever type they come as."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal import igtl
from sonocal.geometry import Array
from sonocal.live.names import frames_of
from sonocal.recording.poses import poses_from_quaternions

__all__ = ["Pose", "pixels_of", "poses_in"]

Pose = tuple[tuple[str, str], Array | None]
"""Whose, in whose frame; (4, 4), None where its sender says that it is none."""


def poses_in(message: igtl.Message) -> Iterator[Pose]:
    """The poses that a message carries."""
    content = message.content
    if isinstance(content, igtl.Transform):
        yield frames_of(message.name), _sound(content.matrix) if message.valid else None
    elif isinstance(content, igtl.Tools):
        for tool in content.tools:
            yield frames_of(tool.name), _sound(tool.matrix)
    elif isinstance(content, igtl.QuaternionTools):
        for one in content.tools:
            yield frames_of(one.name), _turned(one.place_mm, one.quaternion)
    elif isinstance(content, igtl.Position) and content.quaternion is not None:
        yield (
            frames_of(message.name),
            _turned(content.place_mm, content.quaternion) if message.valid else None,
        )


def pixels_of(image: igtl.Image) -> NDArray[Any]:
    """(rows, columns) or (slices, rows, columns): of colour its grey, for a needle has none."""
    pixels = image.pixels
    if pixels.ndim == 4:
        pixels = _grey(pixels)
    return np.asarray(pixels[0]) if len(pixels) == 1 else pixels


def _grey(pixels: NDArray[Any]) -> NDArray[Any]:
    colours = pixels[..., :3] if pixels.shape[3] > 2 else pixels[..., :1]
    first = colours[..., 0]
    if all(np.array_equal(first, colours[..., i]) for i in range(1, colours.shape[3])):
        return np.ascontiguousarray(first)
    weights = np.array([0.299, 0.587, 0.114], dtype=np.float32)  # ITU-R BT.601 luma
    return np.asarray(np.rint(colours.astype(np.float32) @ weights), dtype=pixels.dtype)


def _sound(matrix: Array) -> Array | None:
    return matrix if np.isfinite(matrix).all() else None


def _turned(place_mm: Array, quaternion: Array) -> Array | None:
    w, xyz = quaternion[0], quaternion[1:]
    if np.isnan(w):  # only x, y, z were sent
        w = np.sqrt(max(0.0, 1.0 - float(xyz @ xyz)))
    whole = np.array([w, *xyz])
    length = float(np.linalg.norm(whole))
    if not (np.isfinite(place_mm).all() and 0 < length < np.inf):
        return None
    one = poses_from_quaternions((whole / length)[None], place_mm[None], "Tool", "Tracker", "a message")
    return np.asarray(one.matrices[0])
