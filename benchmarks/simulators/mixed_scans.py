"""Scans of phantoms of beads, wires and walls by a probe that moves over them, and what may be wrong with such scans.

NumPy alone, and what the scans of needles are made with: what judges an estimator shares nothing with it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from benchmarks.simulators.trust_scans import (
    FRAMES_PER_S,
    SIDE_PX,
    Array,
    a_truth,
    corners_of,
    rigid,
    waves,
)

SPANS = {"bead": 1, "wire": 2, "wall": 3}
# Of each mix: how many of each thing, and the dimension of the images.
PHANTOMS: dict[str, tuple[dict[str, int], int]] = {
    "beads and wires": ({"bead": 4, "wire": 4}, 2),
    "walls": ({"wall": 5}, 2),
    "lines and planes, 3D": ({"wire": 4, "wall": 4}, 3),
}
TURN, SHIFT_MM, ROOM_MM, HALF_MM = 0.6, 35.0, 40.0, 80.0
SIGMA_PX, SIGMA_MM = 1.0, 0.3


@dataclasses.dataclass(frozen=True)
class MixedScan:
    """N points of images, each against a bead, a wire or a wall, as recorded.

    Attributes:
        time_s, frame: (N,).
        target: (N,), names.
        spans: (N,): 1 a bead, 2 a wire, 3 a wall.
        points_px: (N, D).
        spanning_mm: (N, 3, 3), in the tracker's frame; what a target does not have is NaN.
        tracker_from_probe: (N, 4, 4), mm.
        truth: (4, 4): mm in the probe marker's frame from px, as they are given.
        corners_px: (M, D).
    """

    time_s: Array
    frame: NDArray[np.int64]
    target: NDArray[np.str_]
    spans: NDArray[np.int64]
    points_px: Array
    spanning_mm: Array
    tracker_from_probe: Array
    truth: Array
    corners_px: Array

    def but(self, **fields: object) -> MixedScan:
        """The scan with other fields."""
        return dataclasses.replace(self, **fields)  # type: ignore[arg-type]

    def spanning_probe(self) -> Array:
        """(N, 3, 3), mm: what spans each target, in the probe marker's frame."""
        turn, shift = self.tracker_from_probe[:, :3, :3], self.tracker_from_probe[:, :3, 3]
        return np.einsum("nji,nkj->nki", turn, self.spanning_mm - shift[:, None])


@dataclasses.dataclass(frozen=True)
class Setting:
    """A phantom in the tracker's frame, and where the image is at any time."""

    phantom: Mapping[str, Array]
    image: Callable[[Array], Array]
    truth: Array
    dimension: int


def setting_of(mix: str, seed: int) -> Setting:
    """A phantom about the tracker's origin, and a probe that swings over it."""
    things, dimension = PHANTOMS[mix]
    rng = np.random.default_rng([seed, 51])
    truth = a_truth(rng, dimension)
    phantom = {
        f"{kind} {i}": a_thing(rng, kind, i, count) for kind, count in things.items() for i in range(count)
    }
    now = waves(rng, 6, 1.0)
    scale = float(np.linalg.norm(truth[:3, 0]))
    middle = np.zeros(3)
    middle[:dimension] = 0.5 * SIDE_PX[dimension]

    def image(time: Array) -> Array:
        """(F, 4, 4): tracker from px."""
        moves = now(time)
        poses = rigid(TURN * moves[:, :3], SHIFT_MM * moves[:, 3:])
        poses[:, :3, :3] *= scale
        poses[:, :3, 3] -= poses[:, :3, :3] @ middle
        return poses

    return Setting(phantom, image, truth, dimension)


def a_thing(rng: np.random.Generator, kind: str, which: int, count: int) -> Array:
    """(3, 3), mm: what spans a bead, a wire or a wall; the rest NaN."""
    place, spanning = rng.uniform(-ROOM_MM, ROOM_MM, 3), np.full((3, 3), np.nan)
    if kind == "bead":
        spanning[0] = place
    elif kind == "wire":
        along = np.append(rng.uniform(-0.7, 0.7, 2), 1.0)
        spanning[:2] = place + HALF_MM * np.array([[-1.0], [1.0]]) * along / np.linalg.norm(along)
    else:  # seen in the image as lines of all directions, and tilted to either side
        angle = np.pi * (which + rng.uniform(-0.3, 0.3)) / count
        normal = np.array([np.cos(angle), np.sin(angle), rng.uniform(-0.7, 0.7)])
        normal /= np.linalg.norm(normal)
        axes = np.linalg.svd(normal[None])[2][1:]
        about = 2 * np.pi / 3 * np.arange(3)
        corners = np.stack([np.cos(about), np.sin(about)], axis=1) @ axes
        spanning[:] = rng.uniform(-20, 20) * normal + HALF_MM * corners
    return spanning


def seen_of(spanning: Array, image: Array, dimension: int, rng: np.random.Generator) -> Array:
    """(P, D), px: points of a thing in an image (4, 4), mm from px; none where it does not show it."""
    inverse, spans = np.linalg.inv(image), int(np.isfinite(spanning[:, 0]).sum())
    there = spanning[:spans] @ inverse[:3, :3].T + inverse[:3, 3]
    side = SIDE_PX[dimension]
    if spans == 1:
        points = there
    elif spans == 2 and dimension == 2:
        along = there[1] - there[0]
        points = (there[0] - along * there[0, 2] / along[2])[None]
    elif dimension == 2:  # where the wall's plane meets that of the image
        normal = np.cross(there[1] - there[0], there[2] - there[0])
        along = np.array([-normal[1], normal[0], 0.0]) / np.linalg.norm(normal[:2])
        foot = normal[:2] * (normal @ there[0]) / (normal[:2] @ normal[:2])
        middle = np.append(foot, 0.0) + along * (along[:2] @ (np.full(2, side / 2) - foot))
        points = middle + rng.uniform(0.15, 0.4, (2, 1)) * side * np.array([[-1.0], [1.0]]) * along
    elif spans == 2:
        along = (there[1] - there[0]) / np.linalg.norm(there[1] - there[0])
        middle = there[0] + along * (along @ (np.full(3, side / 2) - there[0]))
        points = middle + rng.uniform(0.15, 0.4, (2, 1)) * side * np.array([[-1.0], [1.0]]) * along
    else:
        normal = np.cross(there[1] - there[0], there[2] - there[0])
        normal /= np.linalg.norm(normal)
        points = rng.uniform(0.1, 0.9, (3, 3)) * side
        points = points - np.outer((points - there[0]) @ normal, normal)
    inside = np.all((points[:, :dimension] > 0) & (points[:, :dimension] < side - 1))
    return points[:, :dimension] if inside else np.zeros((0, dimension))


def moments_of(setting: Setting, seconds: float) -> Array:
    """(F,), s: evenly, and when the plane of a 2D image comes upon a bead."""
    steady = np.arange(round(seconds * FRAMES_PER_S)) / FRAMES_PER_S
    fine = np.arange(0, steady[-1], 0.002)
    if setting.dimension == 3:
        return steady
    poses = np.linalg.inv(setting.image(fine))
    found = [steady]
    for spanning in setting.phantom.values():
        if np.isnan(spanning[1, 0]):
            depth = poses[:, 2, :3] @ spanning[0] + poses[:, 2, 3]
            at = np.flatnonzero(np.sign(depth[1:]) != np.sign(depth[:-1]))
            found.append(fine[at] + 0.002 * depth[at] / (depth[at] - depth[at + 1]))
    return np.unique(np.concatenate(found).round(9))


def clean(mix: str, seed: int, seconds: float = 12.0, *, latency_s: float = 0.0) -> MixedScan:
    """A scan without noise; the tracker reports where the probe was `latency_s` ago."""
    setting, rng = setting_of(mix, seed), np.random.default_rng([seed, 52])
    times = moments_of(setting, seconds)
    images, probe_from_image = setting.image(times), setting.truth
    probes = setting.image(times - latency_s) @ np.linalg.inv(probe_from_image)
    rows = []
    for frame, image in enumerate(images):
        for name, spanning in setting.phantom.items():
            if np.isnan(spanning[1, 0]) and setting.dimension == 2:
                inverse = np.linalg.inv(image)
                if abs(inverse[2, :3] @ spanning[0] + inverse[2, 3]) > 1e-3:  # px off the image's plane
                    continue
            rows += [
                (frame, name, point, spanning) for point in seen_of(spanning, image, setting.dimension, rng)
            ]
    frame = np.array([row[0] for row in rows])
    spanning = np.array([row[3] for row in rows])
    return MixedScan(
        time_s=times[frame],
        frame=frame,
        target=np.array([row[1] for row in rows]),
        spans=np.isfinite(spanning[:, :, 0]).sum(axis=1),
        points_px=np.array([row[2] for row in rows]),
        spanning_mm=spanning,
        tracker_from_probe=probes[frame],
        truth=probe_from_image,
        corners_px=corners_of(setting.dimension),
    )


def sightings_of(scan: MixedScan) -> NDArray[np.int64]:
    """(N,): rows of one frame and target share a number."""
    keys = np.char.add(np.char.add(scan.frame.astype(str), "/"), scan.target)
    return np.unique(keys, return_inverse=True)[1].reshape(-1)


def noisy(
    scan: MixedScan, rng: np.random.Generator, pose_mm: float = 0.1, pose_rad: float = 1e-3
) -> MixedScan:
    """Noise of points, of what spans a target in every sighting, and of the probe's pose in every frame."""
    each = rng.normal(size=(int(sightings_of(scan).max()) + 1, 3, 3))[sightings_of(scan)]
    off = rng.normal(size=(int(scan.frame.max()) + 1, 6))[scan.frame]
    return scan.but(
        points_px=scan.points_px + SIGMA_PX * rng.normal(size=scan.points_px.shape),
        spanning_mm=scan.spanning_mm + SIGMA_MM * each,
        tracker_from_probe=scan.tracker_from_probe @ rigid(pose_rad * off[:, :3], pose_mm * off[:, 3:]),
    )


def sound(mix: str, seed: int, seconds: float = 12.0) -> MixedScan:
    """A scan with nothing but noise."""
    return noisy(clean(mix, seed, seconds), np.random.default_rng([seed, 53]))


# --- faults ----------------------------------------------------------------------------------------------------


def other_unit(mix: str, seed: int, factor: float) -> MixedScan:
    """All lengths times a factor."""
    scan = sound(mix, seed)
    poses = scan.tracker_from_probe.copy()
    poses[:, :3, 3] *= factor
    return scan.but(spanning_mm=scan.spanning_mm * factor, tracker_from_probe=poses)


def mirrored(mix: str, seed: int, _: float) -> MixedScan:
    """Images whose last axis runs the wrong way."""
    scan = sound(mix, seed)
    side = scan.corners_px.max()
    turned = scan.points_px.copy()
    turned[:, -1] = side - turned[:, -1]
    flip = np.eye(4)
    axis = scan.points_px.shape[1] - 1
    flip[axis, axis], flip[axis, 3] = -1.0, side
    return scan.but(points_px=turned, truth=scan.truth @ flip)


def late(mix: str, seed: int, ms: float) -> MixedScan:
    """Poses that are later than their images."""
    return noisy(clean(mix, seed, latency_s=1e-3 * ms), np.random.default_rng([seed, 53]))


def slipped(mix: str, seed: int, mm: float) -> MixedScan:
    """The probe's marker moves by so much halfway, and turns by 3 degrees."""
    scan, rng = sound(mix, seed), np.random.default_rng([seed, 54])
    turn, shift = rng.normal(size=(2, 3))
    slip = rigid(
        np.radians(3.0) * turn[None] / np.linalg.norm(turn), mm * shift[None] / np.linalg.norm(shift)
    )
    after = (scan.frame > scan.frame.max() / 2)[:, None, None]
    return scan.but(
        tracker_from_probe=np.where(after, scan.tracker_from_probe @ slip, scan.tracker_from_probe)
    )


def unequal(mix: str, seed: int, percent: float) -> MixedScan:
    """Pixels that are longer along v than along u."""
    scan = sound(mix, seed)
    stretch, factor = np.eye(4), 1.0 + percent / 100.0
    stretch[1, 1] = factor
    points, corners = scan.points_px.copy(), scan.corners_px.copy()
    points[:, 1] /= factor
    corners[:, 1] /= factor
    return scan.but(points_px=points, corners_px=corners, truth=scan.truth @ stretch)


def drifting(mix: str, seed: int, mm: float) -> MixedScan:
    """The phantom wanders by so much, as the tracker sees it, from the scan's begin to its end."""
    scan, rng = sound(mix, seed), np.random.default_rng([seed, 55])
    way = rng.normal(size=3)
    part = (scan.time_s / scan.time_s.max())[:, None, None]
    return scan.but(spanning_mm=scan.spanning_mm + mm * part * way / np.linalg.norm(way))


def displaced(mix: str, seed: int, mm: float) -> MixedScan:
    """One target is not where it is said to be: a wall along its normal, a wire and a bead along any direction."""
    scan, rng = sound(mix, seed), np.random.default_rng([seed, 56])
    name = rng.choice(np.unique(scan.target))
    rows = scan.target == name
    spanning = setting_of(mix, seed).phantom[name]
    way = rng.normal(size=3)
    if SPANS[name.split()[0]] == 3:
        way = np.cross(spanning[1] - spanning[0], spanning[2] - spanning[0])
    elif SPANS[name.split()[0]] == 2:
        way = np.cross(spanning[1] - spanning[0], way)
    moved = scan.spanning_mm + mm * way / np.linalg.norm(way)
    return scan.but(spanning_mm=np.where(rows[:, None, None], moved, scan.spanning_mm))


def outliers(mix: str, seed: int, percent: float) -> MixedScan:
    """Sightings that are anywhere in the image."""
    scan, rng = sound(mix, seed), np.random.default_rng([seed, 57])
    sighting = sightings_of(scan)
    wrong = (rng.random(sighting.max() + 1) < percent / 100.0)[sighting]
    anywhere = rng.uniform(0, scan.corners_px.max(), scan.points_px.shape)
    return scan.but(points_px=np.where(wrong[:, None], anywhere, scan.points_px))


FAULTS: dict[str, tuple[Callable[[str, int, float], MixedScan], float, str]] = {
    "lengths in metres": (other_unit, 1e-3, "times"),
    "lengths in centimetres": (other_unit, 0.1, "times"),
    "mirrored image": (mirrored, 1.0, "axis"),
    "latency": (late, 100.0, "ms"),
    "slipped marker": (slipped, 5.0, "mm"),
    "unequal pixels": (unequal, 10.0, "%"),
    "drift": (drifting, 2.0, "mm"),
    "one target displaced": (displaced, 5.0, "mm"),
    "outliers": (outliers, 30.0, "%"),
}

__all__ = ["FAULTS", "PHANTOMS", "MixedScan", "sound"]
