"""Ultrasound images of needles: speckle and echoes in beam coordinates, then scan conversion.

The model is linear up to the envelope, as a scanner's is: echoes and many unresolved scatterers are blurred by a
point spread function that widens with depth, added as complex numbers, and only then turned into brightness. Fully
developed speckle has a Rayleigh envelope for that reason (Wagner et al., Statistics of speckle in ultrasound
B-scans, IEEE Trans. Sonics Ultrasonics 30, 1983).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.geometry import Array
from sonocal.simulation.ultrasound_probe import ProbeGeometry

__all__ = ["BATH", "SMALL_PARTS", "SMALL_PARTS_BATH", "Echo", "Look", "UltrasoundImager"]

Image = NDArray[np.uint8]
Complex = NDArray[np.complex64]
GREY = 255


@dataclass(frozen=True)
class Look:
    """How the scanner and what it looks into appear; dB are of amplitude, 0 dB is white.

    Attributes:
        speckle_db: mean brightness of the speckle.
        needle_db: of a needle across the beam.
        oblique_db: what is left of it when the needle is far from across the beam.
        specular: angle over which it falls off, rad (standard deviation).
        tail_db: from one reverberation of the needle to the next.
        tail_mm: their distance.
        tail_count: how many.
        roughness: share of a needle's echo with a phase of its own.
        dynamic_range_db: from black to white.
        gain_db: added to everything but the receiver's noise floor.
        noise_db: the receiver's noise at the deepest sample.
        attenuation_db: lost from the top to the bottom that time gain does not make up for.
        axial_mm: point spread along the beam (standard deviation).
        lateral_mm: across it, at the face and at the bottom.
        elevation_mm: half thickness of a 2D image, at the face and at the bottom (standard deviation).
        haze_db: slow variation of the speckle's brightness (standard deviation).
        near_field_db: of the bright band under the face.
    """

    speckle_db: float = -40.0
    needle_db: float = 0.0
    oblique_db: float = -10.0
    specular: float = 0.5
    tail_db: float = -7.0
    tail_mm: float = 1.6
    tail_count: int = 8
    roughness: float = 0.3
    dynamic_range_db: float = 60.0
    gain_db: float = 0.0
    noise_db: float = -52.0
    attenuation_db: float = 6.0
    axial_mm: float = 0.35
    lateral_mm: tuple[float, float] = (0.5, 1.3)
    elevation_mm: tuple[float, float] = (1.0, 2.0)
    haze_db: float = 3.0
    near_field_db: float = 22.0


BATH = Look(speckle_db=-66.0, needle_db=0.0, near_field_db=10.0, noise_db=-66.0)
"""A needle in water at low gain: black but for what reflects, as in recordings of wire phantoms."""

SMALL_PARTS = Look(
    axial_mm=0.15,
    lateral_mm=(0.3, 0.5),
    elevation_mm=(0.5, 0.9),
    tail_mm=0.8,
    tail_count=6,
    attenuation_db=4.0,
)
"""A linear probe of higher frequency: finer in every direction."""

SMALL_PARTS_BATH = replace(SMALL_PARTS, speckle_db=-66.0, near_field_db=10.0, noise_db=-66.0)


@dataclass(frozen=True, eq=False)
class Echo:
    """Points that reflect, mm in the image's axes, with their amplitudes.

    Attributes:
        points_mm: (N, 3).
        amplitudes: (N,): of white, before gain; 1 is 0 dB. Complex where the phases are given, else they are random.
        shadow: share of the amplitude that is lost behind the echo, 0 to 1.
    """

    points_mm: Array
    amplitudes: NDArray[Any]
    shadow: float = 0.0


class UltrasoundImager:
    """Makes images of echoes; what does not change between images is computed once.

    Args:
        geometry: the probe.
        look: the appearance.
    """

    def __init__(self, geometry: ProbeGeometry, look: Look | None = None) -> None:
        self.geometry, self.look = geometry, look or Look()
        self._depth = np.linspace(0.0, 1.0, geometry.samples)
        self._filters = self._point_spread()
        self._pixels, self._beams = self._scan_conversion()

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Which pixels the beams reach, indexed like an image."""
        inside = np.zeros(int(np.prod(self.geometry.size_px)), dtype=bool)
        inside[self._pixels] = True
        return inside.reshape(self.geometry.size_px[::-1])

    def image(self, echoes: list[Echo], rng: np.random.Generator) -> Image:
        """An image of some echoes in speckle: (height, width) or (depth, height, width), uint8."""
        return self.scan_convert(self.compress(self.envelope(echoes, rng)))

    def envelope(self, echoes: list[Echo], rng: np.random.Generator) -> NDArray[np.float32]:
        """The amplitude in beam coordinates; 1 is 0 dB."""
        field = self._speckle(rng)
        for echo in echoes:
            self._deposit(field, echo, rng)
        field = self._blur(field)
        noise = _complex_normal(rng, field.shape) * self._along_depth(
            _amplitude(self.look.noise_db) * self._depth
        )
        gain = _amplitude(self.look.gain_db - self.look.attenuation_db * self._depth)
        return np.abs(field * self._along_depth(gain) + noise)

    def compress(self, envelope: NDArray[np.float32]) -> NDArray[np.float32]:
        """Grey levels, 0 to 255, of amplitudes: logarithmic, as a scanner shows them."""
        decibel = 20 * np.log10(np.maximum(envelope, 1e-6))
        return np.clip(GREY * (1 + decibel / np.float32(self.look.dynamic_range_db)), 0, GREY)

    def scan_convert(self, grey: NDArray[np.float32]) -> Image:
        """Beam coordinates to pixels, linearly; black where no beam runs."""
        from scipy.ndimage import map_coordinates

        image = np.zeros(int(np.prod(self.geometry.size_px)), dtype=np.uint8)
        image[self._pixels] = map_coordinates(grey, self._beams, order=1, mode="nearest") + 0.5
        return image.reshape(self.geometry.size_px[::-1])

    def needle(self, segment_mm: Array, rng: np.random.Generator) -> Echo:
        """The echo of a needle, given by two points: bright across the beam, with a tail behind it.

        A 2D image is a slab: the needle shows where it crosses, weighted with the slab's profile. In a volume it
        shows from where it enters the fan to where it leaves it.
        """
        points, weights = (
            self._crossing(segment_mm) if self.geometry.dimension == 2 else self._inside(segment_mm)
        )
        if len(points) == 0:
            return Echo(np.empty((0, 3)), np.empty(0))
        look, along = self.look, segment_mm[1] - segment_mm[0]
        away = self.geometry.beam_directions(points)
        tilt = np.arcsin(np.clip(np.abs(away @ along) / np.linalg.norm(along), 0, 1))
        rough = _amplitude(look.oblique_db)
        amplitude = _amplitude(look.needle_db) * (
            rough + (1 - rough) * np.exp(-0.5 * (tilt / look.specular) ** 2)
        )
        order = np.arange(look.tail_count + 1)
        places = points + order[:, None, None] * look.tail_mm * away
        phases = _phases(rng, len(order))[:, None] * (
            1 + look.roughness * _complex_normal(rng, (len(order), len(points)))
        )
        strengths = _amplitude(look.tail_db * order)[:, None] * phases * (amplitude * weights)
        return Echo(places.reshape(-1, 3), strengths.reshape(-1), shadow=0.0)

    def _crossing(self, segment_mm: Array) -> tuple[Array, Array]:
        start, along = segment_mm[0], segment_mm[1] - segment_mm[0]
        if along[2] == 0:
            return np.empty((0, 3)), np.empty(0)
        crossing = start - along * (start[2] / along[2])
        depth = np.clip(self.geometry.beams_of(crossing)[0] / (self.geometry.samples - 1), 0, 1)
        sigma = np.interp(depth, [0, 1], self.look.elevation_mm)
        # Far below the slab's thickness a needle in the plane would be endless; 30 mm fill any blob.
        reach = np.clip(3 * sigma * np.linalg.norm(along) / abs(along[2]), 0.5, 30.0)
        steps = np.linspace(-reach, reach, 61)[:, None]
        points = crossing + steps * along / np.linalg.norm(along)
        weights = np.exp(-0.5 * (points[:, 2] / sigma) ** 2)
        flat = points * [1.0, 1.0, 0.0]
        return flat, weights / weights.sum()

    def _inside(self, segment_mm: Array) -> tuple[Array, Array]:
        # Closer than the point spread, so that the points run together; 1 is one needle's brightness.
        step = self.look.axial_mm
        along = (segment_mm[1] - segment_mm[0]) / np.linalg.norm(segment_mm[1] - segment_mm[0])
        reach = 2 * (self.geometry.depth_mm + self.geometry.top_mm)
        points = segment_mm.mean(axis=0) + np.arange(-reach, reach, step)[:, None] * along
        beams = self.geometry.beams_of(points)
        keep = ((beams >= 0) & (beams <= np.array(self.geometry.grid_shape) - 1)).all(axis=1)
        return points[keep], np.full(keep.sum(), step / (np.sqrt(2 * np.pi) * self.look.lateral_mm[1]))

    def _speckle(self, rng: np.random.Generator) -> Complex:
        from scipy.ndimage import zoom

        shape = self.geometry.grid_shape
        coarse = rng.standard_normal(tuple(max(3, n // 48) for n in shape)).astype(np.float32)
        haze = zoom(coarse, [n / c for n, c in zip(shape, coarse.shape, strict=True)], order=1)
        near = self.look.near_field_db * np.exp(-((self._depth / 0.07) ** 2))
        level = self._along_depth(self.look.speckle_db + near) + np.float32(self.look.haze_db) * haze
        return _complex_normal(rng, shape) * (_amplitude(level) * self._along_depth(1 / self._energy))

    def _deposit(self, field: Complex, echo: Echo, rng: np.random.Generator) -> None:
        """Adds points between the grid's nodes to the nodes around them, linearly."""
        shape = np.array(field.shape)
        beams = self.geometry.beams_of(echo.points_mm)
        base = np.floor(beams).astype(int)
        keep = ((base >= 0) & (base < shape - 1)).all(axis=1)
        base, part, strength = base[keep], (beams - base)[keep], echo.amplitudes[keep]
        if echo.shadow and len(base):
            first, last = base[:, 1].min(), base[:, 1].max() + 2
            field[int(base[:, 0].max()) + 2 :, first:last] *= np.float32(1 - echo.shadow)
        if not np.iscomplexobj(strength):
            strength = strength * _phases(rng, len(strength))
        for corner in np.ndindex(*(2,) * len(shape)):
            share = np.prod(np.where(np.array(corner) == 1, part, 1 - part), axis=1)
            np.add.at(field, tuple((base + corner).T), (share * strength).astype(np.complex64))

    def _point_spread(self) -> list[NDArray[np.float32]]:
        """Transfer functions, one an axis, of Gaussians of height 1; the lateral ones widen with depth."""
        from scipy.fft import fftfreq, next_fast_len

        geometry, look = self.geometry, self.look
        step = geometry.depth_mm / (geometry.samples - 1)
        lateral = np.interp(self._depth, [0, 1], look.lateral_mm)
        widths = [np.full(geometry.samples, look.axial_mm / step)]
        widths += [lateral / spacing for spacing in geometry.spacings_mm()]
        # A blur narrower than the grid's nodes would make an echo's height depend on where it falls.
        widths = [np.maximum(width, 0.6) for width in widths]
        # White noise through a Gaussian of height 1 gets this standard deviation.
        self._energy = np.sqrt(np.prod([np.sqrt(np.pi) * width for width in widths], axis=0))
        filters = []
        for axis, (n, width) in enumerate(zip(geometry.grid_shape, widths, strict=True)):
            # Room for what is blurred over the edge, or it would come in again on the other side.
            omega = 2 * np.pi * fftfreq(next_fast_len(n + int(4 * width.max())))
            if axis == 0:
                transfer = width[0] * np.exp(-0.5 * (width[0] * omega) ** 2)
            else:
                transfer = width[:, None] * np.exp(-0.5 * (width[:, None] * omega) ** 2)
            filters.append((np.sqrt(2 * np.pi) * transfer).astype(np.float32))
        return filters

    def _blur(self, field: Complex) -> Complex:
        from scipy.fft import fft, ifft

        for axis, transfer in enumerate(self._filters):
            n, padded = field.shape[axis], transfer.shape[-1]
            shape = [1] * field.ndim
            shape[0], shape[axis] = field.shape[0], padded
            blurred = ifft(fft(field, n=padded, axis=axis) * transfer.reshape(shape), axis=axis)
            field = blurred[(slice(None),) * axis + (slice(n),)]
        return field

    def _scan_conversion(self) -> tuple[NDArray[np.int64], Array]:
        beams = self.geometry.beams_of(self.geometry.pixels_mm()).reshape(-1, self.geometry.dimension)
        inside = ((beams >= 0) & (beams <= np.array(self.geometry.grid_shape) - 1)).all(axis=1)
        return np.flatnonzero(inside), np.ascontiguousarray(beams[inside].T, dtype=np.float32)

    def _along_depth(self, values: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
        return values.astype(np.float32).reshape(-1, *(1,) * (self.geometry.dimension - 1))


def _amplitude(decibel: ArrayLike) -> NDArray[np.float32]:
    return np.asarray(np.power(np.float32(10), np.asarray(decibel, dtype=np.float32) / 20))


def _complex_normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Complex:
    """Of mean square 1."""
    pairs = rng.standard_normal((*shape, 2), dtype=np.float32) * np.float32(np.sqrt(0.5))
    return np.asarray(pairs.view(np.complex64)[..., 0])


def _phases(rng: np.random.Generator, count: int) -> NDArray[np.complex128]:
    return np.asarray(np.exp(2j * np.pi * rng.random(count)))
