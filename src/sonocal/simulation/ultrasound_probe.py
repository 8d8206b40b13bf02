"""Where a probe's beams run through its image: curvilinear and linear, 2D and 3D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array

__all__ = ["ProbeGeometry", "curvilinear", "curvilinear_3d", "linear"]


@dataclass(frozen=True)
class ProbeGeometry:
    """An image and the beams it is made from. Lengths in mm of the image's own axes (px times scale).

    A beam grid has one axis for depth (`samples`), one for the beams in the plane (`lines`) and, in 3D,
    one for the planes of a swept probe (`planes`).

    Attributes:
        size_px: (width, height) or (width, height, depth).
        scale_mm_per_px: isotropic.
        depth_mm: along a beam.
        top_mm: where the middle beam starts, below the image's upper edge.
        radius_mm: of the transducer's face; infinite for a linear probe.
        half_angle: of the fan, rad; of no meaning for a linear probe.
        half_width_mm: of a linear probe's face.
        half_sweep: of a 3D probe's planes, rad.
        samples, lines, planes: the beam grid's size.
    """

    size_px: tuple[int, ...]
    scale_mm_per_px: float
    depth_mm: float
    top_mm: float
    radius_mm: float = np.inf
    half_angle: float = 0.0
    half_width_mm: float = 0.0
    half_sweep: float = 0.0
    samples: int = 448
    lines: int = 192
    planes: int = 1

    def __post_init__(self) -> None:
        if len(self.size_px) not in (2, 3) or min(self.size_px) < 16:
            raise InputError(f"an image needs two or three sides of 16 px or more; got {self.size_px}")
        if not (self.scale_mm_per_px > 0 and self.depth_mm > 0):
            raise InputError(
                f"scale and depth must be positive; got {self.scale_mm_per_px} mm/px and {self.depth_mm} mm"
            )

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.size_px)

    @property
    def kind(self) -> Literal["linear", "curvilinear"]:
        """By the shape of the face."""
        return "curvilinear" if np.isfinite(self.radius_mm) else "linear"

    @property
    def grid_shape(self) -> tuple[int, ...]:
        """(samples, lines) or (samples, lines, planes)."""
        return (self.samples, self.lines, self.planes)[: self.dimension]

    @property
    def origin_mm(self) -> Array:
        """(3,): the centre of the fan's circle, or of a linear probe's face."""
        w = 0.0 if self.dimension == 2 else self._middle(2)
        radius = self.radius_mm if self.kind == "curvilinear" else 0.0
        return np.array([self._middle(0), self.top_mm - radius, w])

    def beams_of(self, points_mm: Array) -> Array:
        """(..., dimension): grid coordinates (sample, line[, plane]) of points (..., 3)."""
        x, y, z = np.moveaxis(points_mm - self.origin_mm, -1, 0)
        if self.kind == "linear":
            coordinates = [y, _share(x, self.half_width_mm)]
        elif self.dimension == 2:
            coordinates = [np.hypot(x, y) - self.radius_mm, _share(np.arctan2(x, y), self.half_angle)]
        else:
            reach = np.hypot(y, z)
            coordinates = [
                np.hypot(x, reach) - self.radius_mm,
                _share(np.arctan2(x, reach), self.half_angle),
                _share(np.arctan2(z, y), self.half_sweep),
            ]
        coordinates[0] = coordinates[0] / self.depth_mm
        return np.stack([c * (n - 1) for c, n in zip(coordinates, self.grid_shape, strict=True)], axis=-1)

    def inside(self, points_mm: Array) -> NDArray[np.bool_]:
        """(...): whether points (..., dimension) lie in the image and where beams run."""
        shown = (points_mm >= 0) & (points_mm <= (np.array(self.size_px) - 1) * self.scale_mm_per_px)
        flat = np.zeros((*points_mm.shape[:-1], 3 - self.dimension))
        beams = self.beams_of(np.concatenate([points_mm, flat], axis=-1))
        reached = (beams >= 0) & (beams <= np.array(self.grid_shape) - 1)
        return np.asarray((reached & shown).all(axis=-1))

    def point_at(self, depth_share: Array, lateral: Array, sweep: Array | float = 0.0) -> Array:
        """(..., 3) mm: the point at a share of the depth (0 to 1) and of the lateral extents (-1 to 1)."""
        depth, lateral, sweep = np.broadcast_arrays(depth_share * self.depth_mm, lateral, sweep)
        if self.kind == "linear":
            offset = np.stack([lateral * self.half_width_mm, depth, np.zeros_like(depth)], axis=-1)
        else:
            r, theta, phi = depth + self.radius_mm, lateral * self.half_angle, sweep * self.half_sweep
            reach = r * np.cos(theta)
            offset = np.stack([r * np.sin(theta), reach * np.cos(phi), reach * np.sin(phi)], axis=-1)
        return np.asarray(self.origin_mm + offset)

    def beam_directions(self, points_mm: Array) -> Array:
        """(..., 3): unit vectors away from the transducer."""
        if self.kind == "linear":
            return np.broadcast_to([0.0, 1.0, 0.0], points_mm.shape)
        away = points_mm - self.origin_mm
        return np.asarray(away / np.linalg.norm(away, axis=-1, keepdims=True))

    def spacings_mm(self) -> list[Array]:
        """Distance between neighbours along each lateral axis, (samples,) each, mm."""
        depth = np.linspace(0, self.depth_mm, self.samples)
        if self.kind == "linear":
            return [np.full(self.samples, 2 * self.half_width_mm / (self.lines - 1))]
        reach = depth + self.radius_mm
        steps = [2 * self.half_angle / (self.lines - 1)]
        if self.dimension == 3:
            steps.append(2 * self.half_sweep / (self.planes - 1))
        return [reach * step for step in steps]

    def pixels_mm(self) -> Array:
        """(V, U, 3) or (W, V, U, 3): the place of every pixel."""
        axes = [np.arange(n) * self.scale_mm_per_px for n in reversed(self.size_px)]
        grid = list(np.meshgrid(*axes, indexing="ij"))[::-1]
        if self.dimension == 2:
            grid.append(np.zeros_like(grid[0]))
        return np.stack(grid, axis=-1)

    def _middle(self, axis: int) -> float:
        return 0.5 * (self.size_px[axis] - 1) * self.scale_mm_per_px


def curvilinear(width_px: int = 500, height_px: int = 500, scale_mm_per_px: float = 0.24) -> ProbeGeometry:
    """An abdominal probe: a fan of 70 degrees from a face of 50 mm radius."""
    depth = 0.84 * height_px * scale_mm_per_px
    return ProbeGeometry(
        size_px=(width_px, height_px),
        scale_mm_per_px=scale_mm_per_px,
        depth_mm=depth,
        top_mm=0.06 * height_px * scale_mm_per_px,
        radius_mm=0.4 * depth,
        half_angle=np.radians(33.0),
    )


def linear(width_px: int = 820, height_px: int = 616, scale_mm_per_px: float = 0.078) -> ProbeGeometry:
    """A small-parts probe: parallel beams from a flat face, in the middle of a wider screen."""
    return ProbeGeometry(
        size_px=(width_px, height_px),
        scale_mm_per_px=scale_mm_per_px,
        depth_mm=0.9 * height_px * scale_mm_per_px,
        top_mm=0.04 * height_px * scale_mm_per_px,
        half_width_mm=0.3 * width_px * scale_mm_per_px,
    )


def curvilinear_3d(side_px: int = 128, scale_mm_per_px: float = 0.9) -> ProbeGeometry:
    """A curvilinear probe swept through 60 degrees, in a cube of voxels."""
    depth = 0.84 * side_px * scale_mm_per_px
    return ProbeGeometry(
        size_px=(side_px,) * 3,
        scale_mm_per_px=scale_mm_per_px,
        depth_mm=depth,
        top_mm=0.06 * side_px * scale_mm_per_px,
        radius_mm=0.4 * depth,
        half_angle=np.radians(33.0),
        half_sweep=np.radians(30.0),
        samples=192,
        lines=80,
        planes=64,
    )


def _share(x: Array, half: float) -> Array:
    return (x + half) / (2 * half)
