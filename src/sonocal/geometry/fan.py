"""The rays of a curved probe: they fan out from the centre of its face's arc, and echoes are placed along them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonocal.geometry.transforms import Array

__all__ = ["Fan"]


@dataclass(frozen=True)
class Fan:
    """The rays of a curved probe in its image.

        apex = face - R v,    r = |x - apex|,    depth of x = r - R

    In a volume the rays fan out to all sides: the sweep has the same centre as the arc.

    Attributes:
        face_px: (d,), the middle of the transducer's face; v runs down from there, away from the apex.
        radius_px: R, of the face.
    """

    face_px: tuple[float, ...]
    radius_px: float

    def below_face(self, points: Array) -> Array:
        """(N, d), px: from the face to each point (N, d) along its ray; nothing for what lies on the face or above."""
        apex = np.array(self.face_px)
        apex[1] -= self.radius_px
        ray = points - apex
        length = np.linalg.norm(ray, axis=1, keepdims=True)
        depth = np.maximum(length - self.radius_px, 0.0)
        return np.asarray(depth / np.maximum(length, np.finfo(float).tiny) * ray)

    def stretched(self, points: Array, ratio: float) -> Array:
        """Points (N, d) whose depths below the face are so many times as large; the inverse has ``1 / ratio``."""
        return np.asarray(points + (ratio - 1.0) * self.below_face(points))
