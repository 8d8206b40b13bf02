"""A simulated sweep of what is fixed in the room: a tank's floor and walls, threads that cross, threads alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array, Similarity
from sonocal.recording import Frames, ImageGeometry, Provenance, Recording
from sonocal.recording.frames import Image
from sonocal.simulation.sweep import random_calibration, runs
from sonocal.simulation.sweep_images import draw_overlay
from sonocal.simulation.sweep_options import check_sweep
from sonocal.simulation.target_poses import held, tracked
from sonocal.simulation.ultrasound import Echo, Look, UltrasoundImager
from sonocal.simulation.ultrasound_probe import ProbeGeometry, curvilinear
from sonocal.simulation.ultrasound_scenery import Scenery
from sonocal.simulation.ultrasound_walls import WallLook, wall_echo
from sonocal.targets import Line, Plane, Target

__all__ = ["SimulatedTargets", "TargetOptions", "TargetTruth", "simulate_targets"]


@dataclass(frozen=True)
class TargetOptions:
    """What happens in a sweep of what is fixed in the room.

    Attributes:
        frames: how many images; targets are seen by turns.
        rate_hz: images a second.
        sigma_px: by which the image shows a target elsewhere, along each axis: refraction.
        sigma_mm: tracking noise of the place at the image's middle along each axis.
        hidden_share: share of the images in which no target shows.
        compact, interfaces: bright things in view on average, beside the targets.
        overlay: whether text and a ruler are drawn over the image.
        seed: of everything random.
    """

    frames: int = 120
    rate_hz: float = 8.0
    sigma_px: float = 0.5
    sigma_mm: float = 0.3
    hidden_share: float = 0.1
    compact: float = 2.0
    interfaces: float = 0.5
    overlay: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        noise = self.sigma_px, self.sigma_mm
        check_sweep(self.frames, self.rate_hz, *noise, hidden_share=self.hidden_share)


@dataclass(frozen=True, eq=False)
class TargetTruth:
    """What is true of such a sweep.

    Attributes:
        probe_from_image: the calibration.
        target: (N,): which target each image is of.
        visible: (N,): whether it shows.
        image_from_room: (N, 4, 4): of the image's axes, mm.
    """

    probe_from_image: Similarity
    target: NDArray[np.int64]
    visible: NDArray[np.bool_]
    image_from_room: Array


@dataclass(frozen=True, eq=False)
class SimulatedTargets:
    """A recording, the targets in it, and the truth."""

    recording: Recording
    targets: tuple[Target, ...]
    truth: TargetTruth
    options: TargetOptions


def simulate_targets(
    targets: tuple[Target, ...],
    geometry: ProbeGeometry | None = None,
    look: Look | None = None,
    options: TargetOptions | None = None,
    wall: WallLook | None = None,
) -> SimulatedTargets:
    """A sweep with known truth; its images are made when they are asked for.

    The probe is held so that each image shows one target: a wall across the beams, about; a wire where it crosses the
    image; a crossing of two threads in the slice, or off it by as much as a hand leaves it.

    Args:
        targets: fixed in the room.
        geometry: the probe; default: a curvilinear 2D probe of 500 x 500 px and 0.24 mm.
        look: the images' appearance.
        options: what happens.
        wall: the walls' appearance.
    """
    geometry, options = geometry or curvilinear(), options or TargetOptions()
    rng = np.random.default_rng([options.seed, 0])
    which = np.arange(options.frames) * len(targets) // options.frames
    calibration = random_calibration(rng, geometry.scale_mm_per_px)
    image_from_room = np.array([held(targets[i], geometry, rng) for i in which])
    truth = TargetTruth(calibration, which, ~runs(rng, options.frames, options.hidden_share), image_from_room)
    volume = geometry.dimension == 3
    recording = Recording(
        times=np.arange(options.frames) / options.rate_hz,
        frames=_Frames(targets, _Imaging(geometry, look or Look(), wall or WallLook()), options, truth),
        poses={"ProbeToTracker": tracked(calibration, image_from_room, geometry, options.sigma_mm, rng)},
        image=ImageGeometry(geometry.size_px, 1, "uint8", "MFA" if volume else "MF", np.eye(4)),
        provenance=Provenance(name=f"simulation (seed {options.seed})"),
    )
    return SimulatedTargets(recording, targets, truth, options)


class _Imaging(NamedTuple):
    """The probe, and how what it sees appears."""

    geometry: ProbeGeometry
    look: Look
    wall: WallLook


class _Frames(Frames):
    """Images of targets, made when they are asked for, each from its own random numbers."""

    def __init__(
        self, targets: tuple[Target, ...], imaging: _Imaging, options: TargetOptions, truth: TargetTruth
    ) -> None:
        self._targets, self._imaging, self._options, self._truth = targets, imaging, options, truth
        self._imager = UltrasoundImager(imaging.geometry, imaging.look)
        self._scenery = Scenery(
            imaging.geometry, len(self) / options.rate_hz, options.compact, options.interfaces, options.seed
        )
        self.shape, self.dtype = imaging.geometry.size_px[::-1], np.dtype(np.uint8)

    def __len__(self) -> int:
        return len(self._truth.target)

    def read(self, index: int) -> Image:
        """Image `index`."""
        rng = np.random.default_rng([self._options.seed, 2, index])
        echoes = self._scenery.echoes(index / self._options.rate_hz, rng)
        geometry, shift = self._imaging.geometry, np.zeros(3)
        sigma = self._options.sigma_px * geometry.scale_mm_per_px
        shift[: geometry.dimension] = rng.normal(scale=sigma, size=geometry.dimension)
        if self._truth.visible[index]:
            for target in self._seen(index):
                echoes += self._echoes(target, index, shift, rng)
        image = self._imager.image(echoes, rng)
        if self._options.overlay:
            draw_overlay(image)
        image.flags.writeable = False
        return image

    def _seen(self, index: int) -> list[Target]:
        """The target that the probe is held to; of wires, which are near one another, all."""
        held = self._targets[self._truth.target[index]]
        return [one for one in self._targets if isinstance(one, Line)] if isinstance(held, Line) else [held]

    def _echoes(self, target: Target, index: int, shift: Array, rng: np.random.Generator) -> list[Echo]:
        pose = self._truth.image_from_room[index]
        shown = target.spanning_mm @ pose[:3, :3].T + pose[:3, 3] + shift
        if isinstance(target, Plane):
            normal = np.cross(*(shown[1:] - shown[0]))
            normal = normal / np.linalg.norm(normal)
            plane = np.append(normal, -normal @ shown[0])
            return wall_echo(plane, self._imaging.geometry, self._imaging.look, self._imaging.wall, rng)
        if isinstance(target, Line):
            return [self._imager.needle(shown, rng)]
        # Two threads, a right angle apart in the room.
        threads = [pose[:3, :3] @ way for way in np.array([[1.0, 0.2, 0.1], [-0.2, 1.0, -0.1]])]
        return [self._imager.needle(shown + np.array([-way, way]), rng) for way in threads]
