"""Scans of needles and wires with known truth, of which everything that a recorder would write is kept.

NumPy and SciPy alone: what judges an estimator shares nothing with it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

NEEDLE_MM = 250.0
SIDE_PX = {2: 500, 3: 220}
MM_PER_PX = {2: 0.24, 3: 0.4}
FRAMES_PER_S = 10.0


@dataclasses.dataclass(frozen=True)
class Scan:
    """N sightings of a straight thing, as recorded.

    Attributes:
        time_s: (N,).
        points_px: (N, P, D): what an image shows; one point in 2D, two of a line in 3D.
        ends_mm: (N, 2, 3): the thing's ends in the tracker's frame.
        tracker_from_probe: (N, 4, 4), mm.
        truth: (4, 4): mm in the probe marker's frame from px, as they are given.
        corners_px: (M, D): the corners of the image, in px as they are given.
        still: the time of a row means nothing.
        frame: (N,) image of each row; None where each is one.
        target: (N,) what each row saw; None where all saw one thing.
    """

    time_s: Array
    points_px: Array
    ends_mm: Array
    tracker_from_probe: Array
    truth: Array
    corners_px: Array
    still: bool = False
    frame: NDArray[np.int64] | None = None
    target: NDArray[np.str_] | None = None

    @property
    def dimension(self) -> int:
        """2 or 3, of the image."""
        return int(self.points_px.shape[2])

    def but(self, **fields: object) -> Scan:
        """The scan with other fields."""
        return dataclasses.replace(self, **fields)  # type: ignore[arg-type]

    def rows(self, index: NDArray[np.int64]) -> Scan:
        """Some of the sightings, each with a frame of its own."""
        names = ("time_s", "points_px", "ends_mm", "tracker_from_probe")
        kept = {name: getattr(self, name)[index] for name in names}
        return self.but(**kept, frame=None, target=None if self.target is None else self.target[index])

    def segments_mm(self) -> Array:
        """(N, 2, 3): the ends in the probe marker's frame."""
        turn, shift = self.tracker_from_probe[:, :3, :3], self.tracker_from_probe[:, :3, 3]
        return np.einsum("nji,nkj->nki", turn, self.ends_mm - shift[:, None])

    def with_segments(self, segments_mm: Array) -> Scan:
        """The scan with other ends in the probe marker's frame."""
        return self.but(ends_mm=carried(self.tracker_from_probe, segments_mm))


@dataclasses.dataclass(frozen=True)
class Motion:
    """Where probe and needle are, as functions of time (N,)."""

    truth: Array
    dimension: int
    probe: Callable[[Array], Array]
    needle: Callable[[Array], tuple[Array, Array]]


def carried(poses: Array, places: Array) -> Array:
    """Places (N, K, 3) carried by poses (N, 4, 4)."""
    return np.einsum("nij,nkj->nki", poses[:, :3, :3], places) + poses[:, None, :3, 3]


def mapped(truth: Array, places_px: Array) -> Array:
    """Places (..., D) of the image in the probe marker's frame, mm."""
    dimension = places_px.shape[-1]
    return places_px @ truth[:3, :dimension].T + truth[:3, 3]


def rigid(rotation_vectors: Array, shifts: Array) -> Array:
    """(N, 4, 4) of rotation vectors (N, 3), rad, and shifts (N, 3), mm."""
    poses = np.tile(np.eye(4), (len(shifts), 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(rotation_vectors).as_matrix()
    poses[:, :3, 3] = shifts
    return poses


def corners_of(dimension: int) -> Array:
    """(2^D, D): the corners of the image, px."""
    grid = np.meshgrid(*[[0.0, SIDE_PX[dimension] - 1.0]] * dimension, indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, dimension)


def a_truth(rng: np.random.Generator, dimension: int) -> Array:
    """A map of an image to a marker on the handle, 50 to 110 mm above it."""
    scale = MM_PER_PX[dimension] * rng.uniform(0.8, 1.2)
    turn = Rotation.random(random_state=rng).as_matrix()
    middle = SIDE_PX[dimension] / 2 * scale
    handle = np.array(
        [
            middle + rng.uniform(-20, 20),
            -rng.uniform(50, 110),
            rng.uniform(-20, 20) + (dimension - 2) * middle,
        ]
    )
    truth = np.eye(4)
    truth[:3, :3], truth[:3, 3] = scale * turn, -turn @ handle
    return truth


def waves(rng: np.random.Generator, count: int, speed: float) -> Callable[[Array], Array]:
    """`count` smooth functions of time between about -1 and 1; at speed 1 they swing in some 8 seconds."""
    frequency = rng.uniform(0.05, 0.2, (4, count)) * 2 * np.pi * speed
    phase = rng.uniform(0, 2 * np.pi, (4, count))
    return lambda time: np.clip(1.6 * np.sin(time[:, None, None] * frequency + phase).mean(axis=1), -1, 1)


def at_random(rng: np.random.Generator, count: int) -> Callable[[Array], Array]:
    """`count` values between -1 and 1, each time others, the same when asked for the same times."""
    seed = int(rng.integers(2**31))
    return lambda time: np.random.default_rng(seed).uniform(-1, 1, (len(time), count))


def ends_and_sight(
    place: Array, tilt: Array, depth: Array, scale: float, dimension: int
) -> tuple[Array, Array]:
    """A needle by where it meets the image, its tilt and how deep it went.

    Args:
        place: (N, D), -1 to 1 across the image.
        tilt: (N, 2), tangents of its angles.
        depth: (N, 1), -1 to 1.
        scale: mm/px.
        dimension: of the image.

    Returns:
        Ends (N, 2, 3), px of the image's axes, and what is seen (N, P, D), px.
    """
    side = SIDE_PX[dimension]
    crossing = np.zeros((len(place), 3))
    crossing[:, :dimension] = (0.5 + 0.46 * place * (1.0 if dimension == 2 else 0.6)) * side
    along = np.column_stack([tilt, np.ones(len(place))])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    length = NEEDLE_MM / scale
    before = length * (0.5 + 0.2 * depth)
    ends = np.stack([crossing - before * along, crossing + (length - before) * along], axis=1)
    if dimension == 2:
        return ends, crossing[:, None, :2]
    span = 0.25 * side * np.array([-1.0, 1.0])
    return ends, crossing[:, None] + span[:, None] * along[:, None]


def a_motion(
    rng: np.random.Generator, dimension: int, *, speed: float = 1.0, still: bool = False, tilt: float = 0.7
) -> Motion:
    """A needle moved through the image of a probe that moves, too; `still`: held anew for every image."""
    truth = a_truth(rng, dimension)
    scale = float(np.linalg.norm(truth[:3, 0]))

    def paths(count: int) -> Callable[[Array], Array]:
        return at_random(rng, count) if still else waves(rng, count, speed)

    place, tilts, depth, probe = paths(dimension), paths(2), paths(1), paths(6)
    turned, shifted = Rotation.random(random_state=rng), rng.uniform(-300, 300, 3)

    def poses(time: Array) -> Array:
        now = probe(time)
        turns = Rotation.from_rotvec(0.5 * now[:, :3]) * turned
        return rigid(turns.as_rotvec(), shifted + 40 * now[:, 3:])

    def needle(time: Array) -> tuple[Array, Array]:
        return ends_and_sight(place(time), tilt * tilts(time), depth(time), scale, dimension)

    return Motion(truth, dimension, poses, needle)


def recorded(motion: Motion, time_s: Array, *, latency_s: float = 0.0, still: bool = False) -> Scan:
    """What a perfect recorder writes; the tracker reports where things were `latency_s` ago."""
    then = time_s - latency_s
    _, seen = motion.needle(time_s)
    ends, _ = motion.needle(then)
    poses = motion.probe(then)
    return Scan(
        time_s=time_s,
        points_px=seen,
        ends_mm=carried(poses, mapped(motion.truth, ends)),
        tracker_from_probe=poses,
        truth=motion.truth,
        corners_px=corners_of(motion.dimension),
        still=still,
    )


def noisy(scan: Scan, rng: np.random.Generator, sigma_px: float = 1.0, sigma_mm: float = 0.4) -> Scan:
    """Independent normal noise on points and ends."""
    return scan.but(
        points_px=scan.points_px + sigma_px * rng.normal(size=scan.points_px.shape),
        ends_mm=scan.ends_mm + sigma_mm * rng.normal(size=scan.ends_mm.shape),
    )


def clean(
    seed: int,
    frames: int = 100,
    dimension: int = 2,
    *,
    still: bool = False,
    speed: float = 1.0,
    latency_s: float = 0.0,
    frames_per_s: float = FRAMES_PER_S,
) -> Scan:
    """A scan without noise."""
    motion = a_motion(np.random.default_rng([seed, 1]), dimension, speed=speed, still=still)
    return recorded(motion, np.arange(frames) / frames_per_s, latency_s=latency_s, still=still)


def sound(
    seed: int,
    frames: int = 100,
    dimension: int = 2,
    *,
    sigma_px: float = 1.0,
    sigma_mm: float = 0.4,
    **how: bool | float,
) -> Scan:
    """A scan with nothing but independent noise."""
    scan = clean(seed, frames, dimension, **how)  # type: ignore[arg-type]
    return noisy(scan, np.random.default_rng([seed, 2]), sigma_px, sigma_mm)


def needles(seed: int, crossing_px: Array, along: Array, truth: Array | None = None) -> Scan:
    """A 2D scan, still, of needles that cross the image at given places (N, 2) in given directions (N, 3).

    Directions are in the image's axes.
    """
    rng = np.random.default_rng([seed, 3])
    truth = a_truth(rng, 2) if truth is None else truth
    count = len(crossing_px)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    half = NEEDLE_MM / 2 / np.linalg.norm(truth[:3, 0])
    middle = np.column_stack([crossing_px, np.zeros(count)])
    ends = np.stack([middle - half * along, middle + half * along], axis=1)
    poses = rigid(
        0.4 * rng.normal(size=(count, 3)), rng.uniform(-300, 300, 3) + 40 * rng.normal(size=(count, 3))
    )
    return Scan(
        time_s=np.arange(count) / FRAMES_PER_S,
        points_px=crossing_px[:, None],
        ends_mm=carried(poses, mapped(truth, ends)),
        tracker_from_probe=poses,
        truth=truth,
        corners_px=corners_of(2),
        still=True,
    )


def through_port(seed: int, frames: int, port_mm: float, away_mm: float) -> Scan:
    """Needles through a port of `port_mm` rms beside the image plane, `away_mm` off, all over the image."""
    rng = np.random.default_rng([seed, 4])
    truth = a_truth(rng, 2)
    scale = np.linalg.norm(truth[:3, 0])
    crossing = rng.uniform(20, 480, (frames, 2))
    port = np.array([250.0, 250.0, away_mm / scale]) + port_mm / scale * rng.normal(size=(frames, 3))
    return needles(seed, crossing, port - np.column_stack([crossing, np.zeros(frames)]), truth)


def in_plane(seed: int, frames: int) -> Scan:
    """Needles of one plane, which cuts the image along a line."""
    rng = np.random.default_rng([seed, 5])
    angle, tilt = rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5)
    line = np.array([np.cos(angle), np.sin(angle)])
    crossing = (
        250 + rng.uniform(-200, 200, (frames, 1)) * line + rng.uniform(-100, 100) * line[::-1] * [-1, 1]
    )
    across = np.array([-np.sin(angle) * tilt, np.cos(angle) * tilt, 1.0])
    along = across + rng.uniform(-0.8, 0.8, (frames, 1)) * np.append(line, 0.0)
    return needles(seed, crossing, along)


def one_direction(seed: int, frames: int, spread_deg: float) -> Scan:
    """Needles of one direction, but for `spread_deg`."""
    rng = np.random.default_rng([seed, 6])
    along = np.append(rng.uniform(-0.5, 0.5, 2), 1.0) + np.radians(spread_deg) * rng.normal(size=(frames, 3))
    return needles(seed, rng.uniform(20, 480, (frames, 2)), along)


def points_within(seed: int, frames: int, width_px: float, height_px: float) -> Scan:
    """Needles of many directions whose points fill a part of the image, anywhere in it."""
    rng = np.random.default_rng([seed, 7])
    extent = np.array([width_px, height_px])
    middle = rng.uniform(extent / 2, 500 - extent / 2)
    crossing = middle + rng.uniform(-0.5, 0.5, (frames, 2)) * extent
    along = np.column_stack([rng.uniform(-0.7, 0.7, (frames, 2)), np.ones(frames)])
    return needles(seed, crossing, along)


def wires(seed: int, frames: int, count: int) -> Scan:
    """Wires fixed in the tracker's frame that a probe turns and moves over; a row a wire and image that shows it."""
    rng = np.random.default_rng([seed, 8])
    truth = a_truth(rng, 2)
    scale = np.linalg.norm(truth[:3, 0])
    # In the axes of the middle image, px.
    place = np.column_stack([rng.uniform(100, 400, (count, 2)), np.zeros(count)])
    along = np.column_stack([rng.uniform(-0.5, 0.5, (count, 2)), np.ones(count)])
    turn = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, (frames, 3))).as_matrix()
    shift = rng.uniform(-1, 1, (frames, 3)) * [60, 60, 100] / (scale / 0.24)
    centre = np.array([250.0, 250.0, 0.0])
    start = np.einsum("fij,wj->fwi", turn, place - centre) + shift[:, None] + centre
    step = np.einsum("fij,wj->fwi", turn, along)
    seen = start - step * (start[..., 2] / step[..., 2])[..., None]
    frame, wire = np.nonzero(np.all((seen[..., :2] > 0) & (seen[..., :2] < 499), axis=-1))
    half = NEEDLE_MM / 2 / scale
    ends_px = np.stack([place - half * along, place + half * along], axis=1)
    # The tracker's frame is the middle image's marker's.
    image = np.tile(np.eye(4), (frames, 1, 1))
    image[:, :3, :3] = turn
    image[:, :3, 3] = shift + centre - turn @ centre
    poses = truth @ np.linalg.inv(image) @ np.linalg.inv(truth)
    return Scan(
        time_s=frame / FRAMES_PER_S,
        points_px=seen[frame, wire][:, None, :2],
        ends_mm=mapped(truth, ends_px)[wire],
        tracker_from_probe=poses[frame],
        truth=truth,
        corners_px=corners_of(2),
        still=True,
        frame=frame,
        target=np.char.add("w", wire.astype(str)),
    )
