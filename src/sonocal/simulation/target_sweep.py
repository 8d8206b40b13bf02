"""A simulated sweep of what is fixed in the room: a tank's floor and walls, threads that cross, threads alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array, Similarity
from sonocal.recording import Frames, ImageGeometry, Poses, Provenance, Recording
from sonocal.recording.frames import Image
from sonocal.simulation.sweep import draw_overlay, random_calibration, runs
from sonocal.simulation.ultrasound import Echo, Look, UltrasoundImager
from sonocal.simulation.ultrasound_probe import ProbeGeometry, curvilinear
from sonocal.simulation.ultrasound_scenery import Scenery
from sonocal.simulation.ultrasound_walls import WallLook, wall_echo
from sonocal.targets import Line, Plane, Point, Target

__all__ = ["SCENES", "SimulatedTargets", "TargetOptions", "TargetTruth", "scene_of", "simulate_targets"]

ROOM = "Tracker"
TANK_MM = 200.0
THREAD_MM = 120.0
SCENES = ("wall", "walls", "cross-wire", "cross-wires", "wires")
ACROSS, TILT, OUT = 0.25, 0.12, 0.5
"""Standard deviations, rad: of a wall against the beam in the image, and out of it; of a thread's lean."""
OFF_SLICE_MM = 0.3
"""How far out of the slice a hand that looks for the brightest image leaves a crossing (standard deviation)."""


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
        if self.frames < 1 or not self.rate_hz > 0:
            raise InputError(f"a sweep needs frames and a rate; got {self.frames} at {self.rate_hz} Hz")
        if not (self.sigma_px >= 0 and self.sigma_mm >= 0):
            raise InputError(f"noise cannot be negative; got {self.sigma_px} px and {self.sigma_mm} mm")
        if not 0 <= self.hidden_share <= 1:
            raise InputError(f"hidden_share is between 0 and 1; got {self.hidden_share}")


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


def scene_of(name: str) -> tuple[Target, ...]:
    """Targets of a scene: one wall, a floor and four walls, one cross-wire, four of them, or nine wires.

    Raises:
        InputError: there is no such scene.
    """
    if name in ("wall", "walls"):
        sides = [("floor", 2, -1), ("left", 0, -1), ("right", 0, 1), ("front", 1, -1), ("back", 1, 1)]
        return tuple(_wall(*side) for side in sides[: 1 if name == "wall" else 5])
    if name in ("cross-wire", "cross-wires"):
        places = np.array([[0.0, 0, 0], [40, 10, -15], [-35, 20, 10], [5, -40, -8]])
        count = 1 if name == "cross-wire" else 4
        return tuple(Point(f"cross {i + 1}", ROOM, place) for i, place in enumerate(places[:count]))
    if name == "wires":
        return tuple(_wire(i) for i in range(9))
    raise InputError(f"there is no scene {name!r}; there are {', '.join(SCENES)}")


def _wall(name: str, axis: int, side: int) -> Plane:
    """A side of the tank, seen from within."""
    middle = 0.5 * TANK_MM * side * np.eye(3)[axis]
    across = np.roll(np.eye(3), -axis, axis=0)[1:]
    corners = 2 * np.pi / 3 * np.arange(3)
    reach = 0.25 * TANK_MM * np.column_stack([np.cos(corners), np.sin(corners)])
    return Plane(name, ROOM, middle + reach @ across)


def _wire(index: int) -> Line:
    """Wires in three layers, of three directions."""
    layer, place = divmod(index, 3)
    angle = layer * np.pi / 3
    along, aside = (
        np.array([np.cos(angle), np.sin(angle), 0.1]),
        np.array([-np.sin(angle), np.cos(angle), 0.0]),
    )
    middle = 25.0 * (place - 1) * aside + 12.0 * (layer - 1) * np.array([0, 0, 1.0])
    return Line(f"wire {index + 1}", ROOM, middle + 0.5 * THREAD_MM * np.array([-along, along]))


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
    image_from_room = np.array([_held(targets[i], geometry, rng) for i in which])
    truth = TargetTruth(calibration, which, ~runs(rng, options.frames, options.hidden_share), image_from_room)
    volume = geometry.dimension == 3
    recording = Recording(
        times=np.arange(options.frames) / options.rate_hz,
        frames=_Frames(targets, _Imaging(geometry, look or Look(), wall or WallLook()), options, truth),
        poses={"ProbeToTracker": _poses(calibration, image_from_room, geometry, options, rng)},
        image=ImageGeometry(geometry.size_px, 1, "uint8", "MFA" if volume else "MF", np.eye(4)),
        provenance=Provenance(name=f"simulation (seed {options.seed})"),
    )
    return SimulatedTargets(recording, targets, truth, options)


def _held(target: Target, geometry: ProbeGeometry, rng: np.random.Generator) -> Array:
    """(4, 4): of the image's axes from the room: how the probe is held to see a target."""
    from scipy.spatial.transform import Rotation

    sweep = rng.uniform(-0.4, 0.4) if geometry.dimension == 3 else 0.0
    at = geometry.point_at(np.array(rng.uniform(0.25, 0.85)), np.array(rng.uniform(-0.6, 0.6)), sweep)
    if isinstance(target, Plane):
        normal = np.cross(*(target.points_mm[1:] - target.points_mm[0]))
        normal = normal * np.sign(
            normal @ target.points_mm.mean(axis=0)
        )  # out of the tank: away from the probe
        shares = rng.dirichlet(np.ones(3))
        down, place = normal / np.linalg.norm(normal), shares @ target.points_mm
        turned = Rotation.from_euler("zx", [rng.normal(scale=ACROSS), rng.normal(scale=TILT)])
        spun = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi) * np.array([0.0, 1.0, 0.0]))
        rotation = (turned * spun).as_matrix() @ _upright(down)
    else:
        place = target.spanning_mm.mean(axis=0)
        spun = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi) * np.array([0.0, 1.0, 0.0]))
        leaning = Rotation.from_rotvec(OUT * rng.normal(size=3))
        rotation = (spun * leaning).as_matrix() @ _upright(np.array([0.0, 0.0, -1.0]))
        if isinstance(target, Line):
            along = target.segment_mm[1] - target.segment_mm[0]
            place = place + rng.uniform(-0.3, 0.3) * along
            crossing = np.array([*(OUT * rng.normal(size=2)), 1.0])
            rotation = _brought(rotation @ along, crossing) @ rotation
        elif geometry.dimension == 2:
            at = at + OFF_SLICE_MM * rng.normal() * np.eye(3)[2]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, at - rotation @ place
    return pose


def _upright(down: Array) -> Array:
    """A rotation that brings a direction of the room to the image's depth."""
    other = np.linalg.svd(down[None])[2][1:]
    rotation = np.stack([other[0], down, np.cross(other[0], down)])
    return np.asarray(rotation)


def _brought(one: Array, other: Array) -> Array:
    """The least rotation that brings one direction to another, or to its opposite."""
    from scipy.spatial.transform import Rotation

    a, b = one / np.linalg.norm(one), other / np.linalg.norm(other)
    b = b if a @ b >= 0 else -b
    axis = np.cross(a, b)
    size = np.linalg.norm(axis)
    turn = axis / max(size, 1e-12) * np.arctan2(size, a @ b)
    return np.asarray(Rotation.from_rotvec(turn).as_matrix())


def _poses(
    truth: Similarity,
    image_from_room: Array,
    geometry: ProbeGeometry,
    options: TargetOptions,
    rng: np.random.Generator,
) -> Poses:
    """Of the probe's marker, off by the tracker's noise: at the image's middle by `sigma_mm`."""
    from scipy.spatial.transform import Rotation

    probe_from_image_mm = np.eye(4)
    probe_from_image_mm[:3, :3], probe_from_image_mm[:3, 3] = truth.rotation, truth.translation
    room_from_probe = np.linalg.inv(probe_from_image_mm @ image_from_room)
    size = np.array([*geometry.size_px, 1][:3]) * geometry.scale_mm_per_px
    middle = truth.rotation @ (0.5 * size) + truth.translation
    poses = []
    for pose in room_from_probe:
        turned, about = np.eye(4), pose[:3, :3] @ middle + pose[:3, 3]
        turned[:3, :3] = Rotation.from_rotvec(options.sigma_mm / 100.0 * rng.normal(size=3)).as_matrix()
        turned[:3, 3] = about - turned[:3, :3] @ about + options.sigma_mm * rng.normal(size=3)
        poses.append(turned @ pose)
    return Poses.of("Probe", ROOM, np.array(poses))


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
