"""A simulated sweep: a hand moves a tracked needle through a probe's image, and a tracker and scanner record it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array, Similarity
from sonocal.recording import (
    ImageGeometry,
    Poses,
    Provenance,
    Recording,
)
from sonocal.simulation.sweep_images import SimulatedFrames
from sonocal.simulation.sweep_motion import HandMotion
from sonocal.simulation.sweep_options import SweepOptions
from sonocal.simulation.ultrasound import Look
from sonocal.simulation.ultrasound_probe import ProbeGeometry, curvilinear
from sonocal.targets import Line

__all__ = [
    "NEEDLE_MM",
    "SimulatedSweep",
    "SweepOptions",
    "Truth",
    "random_calibration",
    "runs",
    "simulate_sweep",
]

NEEDLE_MM = 400.0
NEEDLE = Line("needle", "Needle", np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -NEEDLE_MM]]))


@dataclass(frozen=True, eq=False)
class Truth:
    """What is true of a sweep.

    Attributes:
        probe_from_image: the calibration.
        points_px: (N, 2): where the needle crosses the image; (N, 2, 3) in 3D: two points of it.
        shown_px: the same with the image point's noise: where the image shows them.
        visible: (N,): whether it shows; a needle that passes the image's edges by does not.
        clear: (N,): whether it shows and nothing else bright, nor the fan's edge, is within 5 mm of it, nor a
            shadow over it (2D).
        latency_s: of the tracker behind the images.
    """

    probe_from_image: Similarity
    points_px: Array
    shown_px: Array
    visible: NDArray[np.bool_]
    clear: NDArray[np.bool_]
    latency_s: float


@dataclass(frozen=True, eq=False)
class SimulatedSweep:
    """A recording, the needle that was moved, and the truth."""

    recording: Recording
    lines: tuple[Line, ...]
    truth: Truth
    options: SweepOptions = field(default_factory=SweepOptions)


def simulate_sweep(
    geometry: ProbeGeometry | None = None, look: Look | None = None, options: SweepOptions | None = None
) -> SimulatedSweep:
    """A sweep with known truth; its images are made when they are asked for.

    Args:
        geometry: the probe; default: a curvilinear 2D probe of 500 x 500 px and 0.24 mm.
        look: the images' appearance.
        options: what happens.

    Returns:
        The sweep; the same seed gives the same images in whatever order they are asked for.
    """
    geometry, options = geometry or curvilinear(), options or SweepOptions()
    rng = np.random.default_rng([options.seed, 0])
    motion = HandMotion(geometry, options.frames / options.rate_hz, rng)
    times = np.arange(options.frames) / options.rate_hz
    visible = ~runs(rng, options.frames, options.hidden_share)
    probe_from_image = random_calibration(rng, geometry.scale_mm_per_px)
    needle_mm = motion.needle(times)
    jitter = np.zeros_like(needle_mm)
    jitter[..., : geometry.dimension] = rng.normal(
        scale=options.sigma_px * geometry.scale_mm_per_px,
        size=(options.frames, geometry.dimension - 1, geometry.dimension),
    )
    shown = _points(needle_mm + jitter, geometry)
    if geometry.dimension == 2:
        visible &= geometry.inside(shown * geometry.scale_mm_per_px)
    frames = SimulatedFrames(geometry, look, options, needle_mm + jitter, visible)
    recording = Recording(
        times=times,
        frames=frames,
        poses=_poses(motion, probe_from_image, times, options, rng),
        image=ImageGeometry(
            geometry.size_px, 1, "uint8", "MFA" if geometry.dimension == 3 else "MF", np.eye(4)
        ),
        provenance=Provenance(name=f"simulation (seed {options.seed})"),
    )
    points = _points(needle_mm, geometry)
    clear = visible if geometry.dimension == 3 else visible & frames.apart(points * geometry.scale_mm_per_px)
    truth = Truth(probe_from_image, points, shown, visible, clear, options.latency_s)
    return SimulatedSweep(recording, (NEEDLE,), truth, options)


def _points(needle_mm: Array, geometry: ProbeGeometry) -> Array:
    if geometry.dimension == 3:
        return needle_mm / geometry.scale_mm_per_px
    start, along = needle_mm[:, 0], needle_mm[:, 1] - needle_mm[:, 0]
    crossing = start - along * (start[:, 2] / along[:, 2])[:, None]
    return np.asarray(crossing[:, :2] / geometry.scale_mm_per_px)


def _poses(
    motion: HandMotion,
    probe_from_image: Similarity,
    times: Array,
    options: SweepOptions,
    rng: np.random.Generator,
) -> dict[str, Poses]:
    # The pose stamped t was true at t - latency.
    instants = times - options.latency_s
    tracker_from_probe = motion.probe(instants)
    ends_probe = probe_from_image @ (motion.needle_ends(instants, NEEDLE_MM) / probe_from_image.scale)
    ends_probe = ends_probe + rng.normal(scale=options.sigma_mm, size=ends_probe.shape)
    probe_from_needle = _needle_poses(ends_probe, motion.roll(instants))
    lost = runs(rng, len(times), options.dropout_share)
    status = tuple("INVALID" if bad else "OK" for bad in lost)
    tracked = {"Probe": tracker_from_probe, "Needle": tracker_from_probe @ probe_from_needle}
    poses = [Poses(name, "Tracker", matrices, ~lost, status) for name, matrices in tracked.items()]
    return {pose.name: pose for pose in poses}


def _needle_poses(ends: Array, roll: Array) -> Array:
    """(N, 4, 4): the tip (the first end) at the origin, the needle along -z, turned about itself by `roll`."""
    z = ends[:, 0] - ends[:, 1]
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    helper = np.where(np.abs(z[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(z, x)
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    poses = np.tile(np.eye(4), (len(ends), 1, 1))
    poses[:, :3, :3] = np.stack([c * x + s * y, c * y - s * x, z], axis=-1)
    poses[:, :3, 3] = ends[:, 0]
    return poses


def runs(rng: np.random.Generator, count: int, share: float, length: int = 10) -> NDArray[np.bool_]:
    """A mask with that share of true entries, in runs: needles and markers vanish for a while at a time."""
    wanted = round(share * count)
    mask = np.zeros(count, dtype=bool)
    while mask.sum() < wanted:
        start = int(rng.integers(count))
        room = wanted - int(mask.sum())
        mask[start : start + min(length, room)] = True
    return mask


def random_calibration(rng: np.random.Generator, scale: float) -> Similarity:
    """A calibration of any rotation, within 100 mm of the marker along each axis."""
    from scipy.spatial.transform import Rotation

    return Similarity(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-100, 100, 3), scale)
