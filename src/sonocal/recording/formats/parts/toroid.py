"""Volumes whose beams fan out twice, brought to cubes.

A beam leaves the arc of a curved array, radius `first_mm`, at the angle theta within its image. Each image is turned by
phi about an axis that is parallel to the array and `axis_mm` below the arc's centre:

    x = r sin(theta)        q = r cos(theta) - axis        y = -q sin(phi)        z = q cos(phi) + axis

u runs along x, v along z, w along y. With `axis` = 0 this is a sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sonocal.errors import FormatError
from sonocal.geometry import Array
from sonocal.recording.frames import Frames, Image

__all__ = ["Toroid", "ToroidFrames"]

# As many cubes as are made of a volume at most, where the samples of its beams would give more.
MOST_CUBES = 1 << 24
LONGEST_MM = 1000.0
OUTSIDE = -2.0


@dataclass(frozen=True, eq=False)
class Toroid:
    """Where the samples of a volume lie.

    Attributes:
        name: of the file, for messages.
        samples: along a beam.
        sample_mm: from sample to sample.
        first_mm: radius of the first sample.
        axis_mm: the axis of the images, below the centre of the arc.
        beams: (J,) rad, theta of each beam of an image.
        images: (K,) rad, phi of each image.
    """

    name: str
    samples: int
    sample_mm: float
    first_mm: float
    axis_mm: float
    beams: Array
    images: Array

    def __post_init__(self) -> None:
        lengths = [self.sample_mm, self.first_mm, self.axis_mm, self.samples * self.sample_mm]
        if (
            not (np.isfinite(lengths).all() and self.sample_mm > 0 and self.first_mm >= 0)
            or np.abs(lengths).max() > LONGEST_MM
        ):
            raise FormatError(
                f"{self.name}: its beams start at {self.first_mm:g} mm with samples of {self.sample_mm:g} mm; "
                "is it damaged?"
            )
        for what, angles in (("beams", self.beams), ("images", self.images)):
            steps = np.diff(angles)
            ordered = len(angles) > 1 and ((steps > 0).all() or (steps < 0).all())
            if not ordered or np.abs(angles).max() >= np.pi / 2:  # NaN is not ordered
                raise FormatError(
                    f"{self.name}: the angles of its {what} do not go one way within half a turn"
                )
        if self.first_mm * np.cos(self.beams).min() <= self.axis_mm:
            raise FormatError(
                f"{self.name}: its images are turned about an axis {self.axis_mm:g} mm within the volume"
            )

    @cached_property
    def _bounds_mm(self) -> Array:
        """(2, 3) least and largest u, v, w; for given angles they are at an end of the beam."""
        r = self.first_mm + self.sample_mm * np.array([0.0, self.samples - 1])[:, None, None]
        theta, phi = self.beams[None, :, None], self.images[None, None, :]
        q = r * np.cos(theta) - self.axis_mm
        x, y, z = r * np.sin(theta) + 0 * phi, -q * np.sin(phi), q * np.cos(phi) + self.axis_mm
        return np.array([[end(one) for one in (x, z, y)] for end in (np.min, np.max)])

    @cached_property
    def step_mm(self) -> float:
        """Of the cubes: that of the samples, or as much as keeps their number within bounds."""
        extent = np.ptp(self._bounds_mm, axis=0)
        return float(max(self.sample_mm, np.cbrt(np.prod(extent + self.sample_mm) / MOST_CUBES)))

    @property
    def origin_mm(self) -> tuple[float, ...]:
        """(u, v, w) of the first cube."""
        return tuple(self._bounds_mm[0].tolist())

    @property
    def size(self) -> tuple[int, int, int]:
        """(u, v, w) cubes."""
        u, v, w = np.floor(np.ptp(self._bounds_mm, axis=0) / self.step_mm).astype(int) + 1
        return int(u), int(v), int(w)

    def plane(self, volume: Image, w: int) -> Image:
        """Cubes [v, u] of one w, from samples (K, J, I): linear between samples, 0 outside."""
        from scipy.ndimage import map_coordinates

        (u0, v0, w0), (nu, nv, _) = self.origin_mm, self.size
        x, z = u0 + self.step_mm * np.arange(nu), (v0 + self.step_mm * np.arange(nv))[:, None]
        y = w0 + self.step_mm * w
        q, phi = np.hypot(y, z - self.axis_mm), np.arctan2(-y, z - self.axis_mm)
        along = q + self.axis_mm
        i = (np.hypot(x, along) - self.first_mm) / self.sample_mm
        j = _places(np.arctan2(x, along), self.beams)
        k = np.broadcast_to(_places(phi, self.images), i.shape)
        values = map_coordinates(volume, [k, j, i], np.float32, order=1, mode="constant", prefilter=False)
        return np.asarray(np.rint(values).astype(volume.dtype))


class ToroidFrames(Frames):
    """Volumes of samples along beams, as cubes."""

    def __init__(self, samples: Frames, toroid: Toroid) -> None:
        self._samples, self._toroid = samples, toroid
        self.shape, self.dtype = toroid.size[::-1], samples.dtype

    def __len__(self) -> int:
        return len(self._samples)

    def read(self, index: int) -> Image:
        """Volume `index`."""
        samples = self._samples.read(index)
        volume = np.empty(self.shape, self.dtype)
        for w in range(len(volume)):
            volume[w] = self._toroid.plane(samples, w)
        volume.flags.writeable = False
        return volume


def _places(angles: Array, table: Array) -> Array:
    """Where angles lie in a table, in steps of it; outside of it where they do."""
    order = slice(None) if table[0] < table[-1] else slice(None, None, -1)
    steps = np.arange(len(table), dtype=float)
    return np.asarray(np.interp(angles, table[order], steps[order], OUTSIDE, OUTSIDE))
