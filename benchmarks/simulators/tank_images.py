"""Images of a water tank by another way than sonocal's simulation: rays, mirrors and rough facets, echo by echo.

A beam is a ray with a width in the image and out of it. What it meets gives echoes at their ranges, with phases: a
wall one where the ray in the middle of the beam meets it (a mirror: it fades as the ray meets it aslant) and many dim
ones over the beam's width (it is rough); a thread those of the points along it. Echoes are put into ranges, blurred by
the pulse as complex numbers, taken as a magnitude, compressed by a logarithm and brought from beams to pixels. NumPy
and SciPy alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, map_coordinates

from benchmarks.simulators.tank_probe import Probe

__all__ = ["Tank", "Thread", "Wall", "tank_image"]

Array = NDArray[np.float64]
STEP_MM = 0.12
PULSE_MM = 0.3
WAVE_MM = 0.5
LATERAL_MM = 0.6
SIDE, OUT = np.linspace(-2, 2, 9), np.linspace(-2, 2, 17)
"""Standard deviations of a beam's widths at which a rough wall is met."""


class Wall(NamedTuple):
    """A flat wall in the image's axes, mm: ``normal . x = offset``, seen where a share of the width allows it."""

    normal: Array
    offset: float
    part: tuple[float, float] = (0.0, 1.0)
    strength: float = 1.0


class Thread(NamedTuple):
    """A thin straight thing between two ends (2, 3), mm; a needle has a tail of echoes below it."""

    ends: Array
    strength: float = 1.0
    tail: float = 0.0


@dataclass(frozen=True)
class Tank:
    """What is wrong with what is seen: 1 is the amplitude that is white.

    Attributes:
        gain: of all amplitudes.
        slice_mm: of the slice's thickness (standard deviation).
        mirror: angle over which a wall fades, rad.
        rough: of what a wall sends back in every direction.
        behind, behind_mm: of the wall's other face.
        twice: of what goes to the wall twice.
        speckle: of what floats in the water.
        spots: other bright things in an image, on average.
        shadow: of what a thread leaves of what is behind it.
    """

    gain: float = 1.0
    slice_mm: float = 1.2
    mirror: float = 0.2
    rough: float = 0.12
    behind: float = 0.4
    behind_mm: float = 5.0
    twice: float = 0.2
    speckle: float = 0.005
    spots: float = 2.0
    shadow: float = 1.0


@dataclass
class _Echoes:
    """Complex amplitudes of beams at ranges (B, R)."""

    probe: Probe
    sums: NDArray[np.complex128] = field(init=False)

    def __post_init__(self) -> None:
        self.sums = np.zeros((self.probe.beams, int(1.2 * self.probe.side_mm / STEP_MM)), dtype=complex)

    def add(self, beam: NDArray[Any], far: Array, amplitude: NDArray[Any]) -> None:
        """Echoes at ranges, shared by the two nearest steps."""
        at = far / STEP_MM
        low = np.floor(at).astype(int)
        for step, share in ((low, 1 - (at - low)), (low + 1, at - low)):
            keep = (step >= 0) & (step < self.sums.shape[1]) & (beam >= 0) & (beam < len(self.sums))
            flat = beam[keep] * self.sums.shape[1] + step[keep]
            value = (amplitude * share)[keep]
            for part, unit in ((value.real, 1.0), (value.imag, 1j)):
                self.sums += unit * np.bincount(flat, part, minlength=self.sums.size).reshape(self.sums.shape)


def tank_image(
    rng: np.random.Generator,
    probe: Probe,
    tank: Tank,
    walls: tuple[Wall, ...] = (),
    threads: tuple[Thread, ...] = (),
) -> NDArray[np.uint8]:
    """Grey levels (rows, columns) of one image."""
    echoes = _Echoes(probe)
    for wall in walls:
        _add_wall(echoes, wall, tank, rng)
    for thread in threads:
        if tank.shadow < 1:
            _shade(echoes, thread, tank)
        _add_thread(echoes, thread, tank, rng)
    for _ in range(rng.poisson(tank.spots)):
        _add_spot(echoes, rng)
    # A pulse adds what falls into its length: of one echo the height is 1, and of noise in every step its root.
    height = np.sqrt(2 * np.pi) * PULSE_MM / STEP_MM
    echoes.sums += tank.speckle / np.sqrt(height / np.sqrt(2)) * _noise(rng, echoes.sums.shape)
    blurred = [
        gaussian_filter1d(one, PULSE_MM / STEP_MM, axis=1) for one in (echoes.sums.real, echoes.sums.imag)
    ]
    amplitude = tank.gain * height * np.hypot(*blurred) + 1e-4
    grey = 255 * (1 + 20 * np.log10(amplitude) / 60)
    return _converted(np.clip(grey, 0, 255), probe)


def _add_wall(echoes: _Echoes, wall: Wall, tank: Tank, rng: np.random.Generator) -> None:
    probe = echoes.probe
    start, way = probe.rays()
    index = np.arange(probe.beams)
    fading = np.exp(0.3 * gaussian_filter1d(rng.normal(size=probe.beams), 8.0) * 5.3)
    facing = way @ wall.normal[:2]
    tilt, lean = (
        np.arccos(np.clip(facing / np.linalg.norm(wall.normal[:2]), -1, 1)),
        np.arcsin(wall.normal[2]),
    )
    mirror = fading * np.exp(-0.5 * (tilt**2 + lean**2) / tank.mirror**2)
    far = (wall.offset - start @ wall.normal[:2]) / facing
    _add_faces(echoes, wall, tank, _Met(index, far, facing, mirror.astype(complex)))
    aside, out = np.meshgrid(SIDE * LATERAL_MM, OUT * tank.slice_mm, indexing="ij")
    weight = np.exp(-0.5 * (aside / LATERAL_MM) ** 2 - 0.5 * (out / tank.slice_mm) ** 2)
    weight = weight / np.sqrt(np.sum(weight**2))
    turned = np.column_stack([way[:, 1], -way[:, 0]]) @ wall.normal[:2]
    spread = (wall.offset - start @ wall.normal[:2])[:, None, None]
    spread = (spread - turned[:, None, None] * aside - wall.normal[2] * out) / facing[:, None, None]
    phases = _noise(rng, spread.shape)
    size = tank.rough * fading[:, None, None] * weight * phases
    every = np.broadcast_to(index[:, None, None], spread.shape)
    facings = np.broadcast_to(facing[:, None, None], spread.shape)
    _add_faces(echoes, wall, tank, _Met(*(one.reshape(-1) for one in (every, spread, facings, size))))


class _Met(NamedTuple):
    """Where beams meet a wall: which, how far, the cosine to its normal, and what comes back."""

    beam: NDArray[Any]
    far: Array
    facing: Array
    size: NDArray[np.complex128]


def _add_faces(echoes: _Echoes, wall: Wall, tank: Tank, met: _Met) -> None:
    """The first face, the other one, and what went to the wall twice."""
    start, way = echoes.probe.rays()
    across = (start[met.beam, 0] + met.far * way[met.beam, 0]) / echoes.probe.side_mm
    keep = (met.facing > 0.05) & (met.far > 0) & (across >= wall.part[0]) & (across <= wall.part[1])
    beam, far, facing, size = (column[keep] for column in met)
    further = (0 * far, tank.behind_mm / facing, far)
    for more, share in zip(further, (1.0, tank.behind, tank.twice), strict=True):
        phase = np.exp(-4j * np.pi * (far + more) / WAVE_MM)
        echoes.add(beam, far + more, wall.strength * share * size * phase)


def _add_thread(echoes: _Echoes, thread: Thread, tank: Tank, rng: np.random.Generator) -> None:
    probe = echoes.probe
    length = float(np.linalg.norm(thread.ends[1] - thread.ends[0]))
    share = (np.arange(int(length / 0.08)) + 0.5) / int(length / 0.08)
    points = thread.ends[0] + share[:, None] * (thread.ends[1] - thread.ends[0])
    points = points[np.abs(points[:, 2]) < 3 * tank.slice_mm]
    if not len(points):
        return
    start, way = probe.rays()
    off = points[:, None, :2] - start
    far = np.einsum("pbi,bi->pb", off, way)
    aside = off[..., 0] * way[:, 1] - off[..., 1] * way[:, 0]
    point, beam = np.nonzero((np.abs(aside) < 3 * LATERAL_MM) & (far > 0))
    far, aside, out = far[point, beam], aside[point, beam], points[point, 2]
    rough = 1 + 1.0 * _noise(rng, (len(points),))[point]
    size = (
        thread.strength
        * 0.12
        * rough
        * np.exp(-0.5 * (aside / LATERAL_MM) ** 2 - 0.5 * (out / tank.slice_mm) ** 2)
    )
    for bounce in range(6 if thread.tail else 1):
        more = far + 1.1 * bounce
        echoes.add(beam, more, thread.tail**bounce * size * np.exp(-4j * np.pi * more / WAVE_MM))


def _shade(echoes: _Echoes, thread: Thread, tank: Tank) -> None:
    """What is behind a thread that crosses the slice is dimmer."""
    way = thread.ends[1] - thread.ends[0]
    crossing = thread.ends[0] - thread.ends[0, 2] / way[2] * way
    beam, far = echoes.probe.beam_of(crossing[:2])
    near = np.abs(np.arange(echoes.probe.beams) - beam) < 3
    behind = np.arange(echoes.sums.shape[1]) * STEP_MM > far + 1
    echoes.sums[np.ix_(near, behind)] *= tank.shadow


def _add_spot(echoes: _Echoes, rng: np.random.Generator) -> None:
    """Something round and rough."""
    probe = echoes.probe
    beam, far = rng.uniform(10, probe.beams - 10), rng.uniform(0.15, 0.95) * probe.side_mm
    count, size = 60, rng.uniform(0.3, 1.0)
    beams = np.rint(beam + 2.5 * rng.normal(size=count)).astype(int)
    echoes.add(beams, far + 1.0 * rng.normal(size=count), size * 0.5 * _noise(rng, (count,)))


def _noise(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.complex128]:
    """Complex, of mean square 1."""
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def _converted(grey: Array, probe: Probe) -> NDArray[np.uint8]:
    """From beams and ranges to pixels; black where no beam runs."""
    rows, cols = np.indices((probe.side_px, probe.side_px))
    beam, far = probe.beam_of(np.stack([cols, rows], axis=-1) * probe.mm_per_px)
    image = map_coordinates(grey, [beam, far / STEP_MM], order=1, mode="constant")
    image[(beam < 0) | (beam > probe.beams - 1) | (far < 0) | (far > probe.side_mm)] = 0
    return np.asarray(np.clip(image, 0, 255).astype(np.uint8))
