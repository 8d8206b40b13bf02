"""Similarities, segments and lines: the nouns of the package.

Conventions: ``target_from_source`` names, column vectors, millimetres, pixels ``(u, v, w)`` with the
origin at the centre of the first pixel, radians, quaternions ``(w, x, y, z)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError
from sonocal.geometry.arrays import frozen, real_array

__all__ = [
    "Array",
    "AxisScaled",
    "Similarity",
    "homogeneous_points",
    "segment_directions",
    "similarity_errors",
]

Array = NDArray[np.float64]

ORTHOGONALITY_TOLERANCE = 1e-6


def homogeneous_points(points: ArrayLike, what: str = "points") -> Array:
    """Points with three coordinates; two-dimensional pixels get ``w = 0``.

    Args:
        points: (..., 2) or (..., 3).
        what: what the message calls them.

    Returns:
        (..., 3).

    Raises:
        InputError: they are no numbers, or the last axis is neither 2 nor 3 long.
    """
    array = real_array(what, points)
    if array.ndim == 0 or array.shape[-1] not in (2, 3):
        raise InputError(f"{what} must have shape (..., 2) or (..., 3); got {array.shape}")
    if array.shape[-1] == 3:
        return array
    return np.concatenate([array, np.zeros((*array.shape[:-1], 1))], axis=-1)


def segment_directions(segments_mm: ArrayLike) -> Array:
    """Unit directions (..., 3) of segments (..., 2, 3) in mm; a segment of zero length gives NaN."""
    segments = np.asarray(segments_mm, dtype=float)
    along = segments[..., 1, :] - segments[..., 0, :]
    with np.errstate(invalid="ignore"):
        return np.asarray(along / np.linalg.norm(along, axis=-1, keepdims=True))


@dataclass(frozen=True, eq=False)
class AxisScaled:
    """A rotation, a translation and one scale per source axis.

        x_target = R diag(scales) x_source + t

    The anisotropic image model of linear probes; `Similarity` is the case of equal scales.

    Attributes:
        rotation: (..., 3, 3), orthonormal, determinant +1.
        translation: (..., 3), mm.
        scales: (..., 3), mm per px, positive.
    """

    rotation: Array
    translation: Array
    scales: Array

    def __post_init__(self) -> None:
        # Copies that nobody writes to: a transform does not change behind the back of what was computed with it.
        for name in ("rotation", "translation", "scales"):
            object.__setattr__(self, name, frozen(np.array(getattr(self, name), dtype=float)))

    def __repr__(self) -> str:
        name = type(self).__name__
        if self.translation.ndim > 1:
            return f"<{name} of shape {self.translation.shape[:-1]}>"
        angle = np.degrees(np.arccos(np.clip((np.trace(self.rotation) - 1.0) / 2.0, -1.0, 1.0)))
        scales = self.scales[:1] if np.ptp(self.scales) == 0 else self.scales
        place = ", ".join(f"{x:.4g}" for x in self.translation)
        scale = " x ".join(f"{s:.4g}" for s in scales)
        return f"<{name}: {scale} mm/px, turned by {angle:.1f} deg, origin at ({place}) mm>"

    @classmethod
    def unchecked(cls, rotation: Array, translation: Array, scales: Array) -> Self:
        """Of arrays that nobody else holds and whose maker has checked them: neither copied nor looked at again.

        Checks and copies take a third of the time of a fit of fifty rows.
        """
        self = object.__new__(cls)
        self.__dict__.update(
            rotation=frozen(rotation), translation=frozen(translation), scales=frozen(scales)
        )
        return self

    @property
    def matrix(self) -> Array:
        """(..., 4, 4): ``[[R diag(scales), t], [0, 1]]``."""
        matrix = np.zeros((*self.translation.shape[:-1], 4, 4))
        matrix[..., :3, :3] = self.rotation * self.scales[..., None, :]
        matrix[..., :3, 3] = self.translation
        matrix[..., 3, 3] = 1.0
        return matrix

    @property
    def quaternion_wxyz(self) -> Array:
        """(..., 4): the rotation as a unit quaternion with ``w >= 0``."""
        from scipy.spatial.transform import Rotation

        xyzw = Rotation.from_matrix(self.rotation).as_quat(canonical=True)
        return np.asarray(np.roll(xyzw, 1, axis=-1))

    def apply(self, points: ArrayLike) -> Array:
        """Map points.

        Args:
            points: (..., 2) or (..., 3), px; their leading axes broadcast with this transform's.

        Returns:
            (..., 3), mm.

        Raises:
            InputError: the last axis is neither 2 nor 3 long.
        """
        scaled = homogeneous_points(points) * self.scales
        return np.asarray(np.einsum("...ij,...j->...i", self.rotation, scaled) + self.translation)

    def __matmul__(self, other: Any) -> Any:
        """``target_from_source @ points_source``."""
        return self.apply(other)


class Similarity(AxisScaled):
    """A rotation, a translation and one scale: ``A = [[s R, t], [0, 1]]``, det R = +1, s > 0.

    ``probe_from_image @ points_px`` gives points in mm; ``a_from_b @ b_from_c`` is ``a_from_c``.

    Args:
        rotation: (..., 3, 3), orthonormal, determinant +1.
        translation: (..., 3), mm.
        scale: (...), mm per px, positive.

    Raises:
        InputError: a shape does not fit, the rotation is none, or the scale is not positive.

    Source: paper eq. (2)-(3).
    """

    def __init__(self, rotation: ArrayLike, translation: ArrayLike, scale: ArrayLike) -> None:
        rotation, translation = real_array("rotation", rotation), real_array("translation", translation)
        scale = real_array("scale", scale)
        _check_parts(rotation, translation, scale)
        # For one transform np.repeat would take longer than everything else here.
        scales = np.array([float(scale)] * 3) if scale.ndim == 0 else np.repeat(scale[..., None], 3, axis=-1)
        super().__init__(rotation, translation, scales)

    @property
    def scale(self) -> Array:
        """(...): mm per px."""
        return self.scales[..., 0]

    @classmethod
    def identity(cls) -> Self:
        """The similarity that moves nothing."""
        return cls(np.eye(3), np.zeros(3), 1.0)

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Self:
        """The similarity of a 4 x 4 matrix.

        Args:
            matrix: (..., 4, 4).

        Raises:
            InputError: not 4 x 4, not finite, or not a scaled rotation beside a translation.
        """
        array = real_array("matrix", matrix)
        if array.shape[-2:] != (4, 4):
            raise InputError(f"a similarity needs a (..., 4, 4) matrix; got shape {array.shape}")
        if not np.array_equal(array[..., 3, :], np.broadcast_to([0, 0, 0, 1.0], array.shape[:-1])):
            raise InputError(f"the last row of a similarity is 0 0 0 1; got {array[..., 3, :].tolist()}")
        if not np.all(np.isfinite(array)):
            raise InputError("a similarity has finite numbers; this matrix holds a NaN or an infinity")
        scale = np.cbrt(np.linalg.det(array[..., :3, :3]))
        if not np.all(scale > 0):
            raise InputError("a similarity does not mirror or flatten; this matrix has determinant <= 0")
        return cls(array[..., :3, :3] / scale[..., None, None], array[..., :3, 3], scale)

    @classmethod
    def from_rotvec(cls, rotvec: ArrayLike, translation: ArrayLike, scale: ArrayLike) -> Self:
        """The similarity of a rotation vector (..., 3) in rad, a translation in mm and a scale."""
        return cls(_rotation_exp(rotvec), translation, scale)

    def inverse(self) -> Similarity:
        """``source_from_target``."""
        transposed = np.swapaxes(self.rotation, -1, -2)
        translation = -np.einsum("...ij,...j->...i", transposed, self.translation) / self.scale[..., None]
        return Similarity(transposed, translation, 1.0 / self.scale)

    def retract(self, tangent: ArrayLike) -> Similarity:
        """A nearby similarity: ``(exp([w]x) R, t + v, s exp(l))`` for the tangent ``(w, v, l)``.

        Args:
            tangent: (..., 7): rotation vector applied on the left (rad), translation (mm), log scale.
        """
        step = np.asarray(tangent, dtype=float)
        return Similarity(
            _rotation_exp(step[..., :3]) @ self.rotation,
            self.translation + step[..., 3:6],
            self.scale * np.exp(step[..., 6]),
        )

    def __matmul__(self, other: Any) -> Any:
        """``a_from_b @ points_b`` or ``a_from_b @ b_from_c``."""
        if not isinstance(other, Similarity):
            return self.apply(other)
        return Similarity(
            self.rotation @ other.rotation, self.apply(other.translation), self.scale * other.scale
        )


def similarity_errors(found: AxisScaled, truth: AxisScaled) -> tuple[Array, Array, Array]:
    """How far one transform is from another, as the paper measures it (section 9.1).

    Returns:
        The angle of ``R^T R_true`` (rad), ``|t - t_true|`` (mm) and ``|s - s_true|`` (mm per px),
        each of the broadcast batch shape; the scale is the mean of the axes.
    """
    residual = np.swapaxes(found.rotation, -1, -2) @ truth.rotation
    # The chord |R^T R_true - I| keeps its digits at small angles, where the arc cosine of the trace loses half.
    chord = np.linalg.norm(residual - np.eye(3), axis=(-2, -1))
    angle = 2.0 * np.arcsin(np.clip(chord / np.sqrt(8.0), 0.0, 1.0))
    distance = np.linalg.norm(found.translation - truth.translation, axis=-1)
    return angle, distance, np.abs(found.scales.mean(-1) - truth.scales.mean(-1))


def _rotation_exp(rotvec: ArrayLike) -> Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(np.asarray(rotvec, dtype=float)).as_matrix())


def _is_sound(rotation: Array, translation: Array, scale: Array) -> bool:
    """The check of one transform in plain numbers: on three of them NumPy takes longer than a whole fit."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    off = max(
        abs(a * a + d * d + g * g - 1.0),
        abs(b * b + e * e + h * h - 1.0),
        abs(c * c + f * f + i * i - 1.0),
        abs(a * b + d * e + g * h),
        abs(b * c + e * f + h * i),
        abs(c * a + f * d + i * g),
    )
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return bool(
        off <= ORTHOGONALITY_TOLERANCE
        and determinant > 0
        and isfinite(off + sum(translation.tolist()))
        and 0 < float(scale) < inf
    )


def _check_parts(rotation: Array, translation: Array, scale: Array) -> None:
    if rotation.shape[-2:] != (3, 3) or translation.shape[-1:] != (3,):
        raise InputError(
            "a similarity needs a rotation (..., 3, 3) and a translation (..., 3); "
            f"got {rotation.shape} and {translation.shape}"
        )
    if (
        rotation.ndim == 2
        and translation.ndim == 1
        and scale.ndim == 0
        and _is_sound(rotation, translation, scale)
    ):
        return
    if not (np.all(np.isfinite(translation)) and np.all(np.isfinite(scale)) and np.all(scale > 0)):
        raise InputError("a similarity needs a finite translation and a positive scale")
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = np.abs(np.swapaxes(rotation, -1, -2) @ rotation - np.eye(3)).max(initial=0.0)
    if not deviation <= ORTHOGONALITY_TOLERANCE or not np.all(np.linalg.det(rotation) > 0):
        raise InputError(
            f"a similarity needs a rotation; this matrix is off by {deviation:.2g} from orthonormal or mirrors"
        )
