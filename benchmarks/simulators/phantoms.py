"""Phantoms of wires and what a tracked probe sees of them: dots whose wire is known here and nowhere else."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

IMAGE_PX = 500.0
LENGTH_MM = 80.0


@dataclasses.dataclass
class Dots:
    """Dots (N, 2) px, or lines (N, 2, 3) px of volumes, their frame and true wire, and the wires as they are tracked.

    A true wire of -1 is none; wires are (F, L, 2, 3) mm.
    """

    points: np.ndarray
    frame: np.ndarray
    truth: np.ndarray
    wires: np.ndarray


def _ends(near, far):
    """(L, 2, 3): wires between two planes 80 mm apart."""
    half = np.full((len(near), 1), LENGTH_MM / 2)
    return np.stack([np.hstack([near, -half]), np.hstack([far, half])], axis=1)


def random_wires(rng, count):
    """So many wires that lean up to 25 degrees, none within 5 mm of another where they start and end."""
    near = _apart(rng, count)
    far = near + rng.uniform(-1, 1, (count, 2)) * np.tan(np.radians(25)) * LENGTH_MM / 2
    return _ends(near, far)


def _apart(rng, count):
    places = []
    while len(places) < count:
        place = rng.uniform(-1, 1, 2) * [24, 18]
        if all(np.linalg.norm(place - other) > 6 for other in places):
            places.append(place)
    return np.array(places)


def n_wires(rows, spacing_mm, width_mm=30.0):
    """Rows of two parallel wires with a slanting one between, as far apart as that; each row begins elsewhere."""
    near, far = [], []
    for row in range(rows):
        depth = (row - (rows - 1) / 2) * spacing_mm
        left, right = -width_mm / 2 + (row % 2) * spacing_mm / 2, width_mm / 2 - (row // 2) * spacing_mm / 2
        down = row % 2 == 0
        near += [[left, depth], [left + 2 if down else right - 2, depth], [right, depth]]
        far += [[left, depth], [right - 2 if down else left + 2, depth], [right, depth]]
    return _ends(np.array(near), np.array(far))


def planes(rng):
    """Two parallel planes of four wires; those of one lean to one side, those of the other to the other."""
    near = np.array([[x, y] for y in (-8.0, 8.0) for x in (-18.0, -7.0, 5.0, 18.0)])
    lean = np.array([[12.0 if y < 0 else -12.0, 0.0] for _, y in near])
    return _ends(near - lean / 2, near + lean / 2 + rng.normal(scale=1.0, size=near.shape))


def symmetric(rng):
    """Six parallel wires at the corners of a regular hexagon, which is all alike when it is turned."""
    angle = np.arange(6) * np.pi / 3
    near = 16 * np.column_stack([np.cos(angle), np.sin(angle)])
    return _ends(near, near)


KINDS = {
    **{
        f"{count} random wires": (lambda rng, n=count: random_wires(rng, n))
        for count in (3, 4, 5, 6, 7, 9, 10, 12)
    },
    "three N, 5 mm apart": lambda rng: n_wires(3, 5.0),
    "three N, 10 mm apart": lambda rng: n_wires(3, 10.0),
    "three N, 20 mm apart": lambda rng: n_wires(3, 20.0),
    "one N": lambda rng: n_wires(1, 20.0),
    "parallel planes": planes,
}


def scan(
    rng,
    wires,
    frames,
    *,
    turn_rad=0.25,
    shift_mm=(8.0, 8.0, 8.0),
    sigma_px=1.0,
    sigma_mm=0.3,
    sigma_rad=0.003,
):
    """What a probe sees that is moved over a phantom; tracking errors are shared by the wires of a frame."""
    scale = rng.uniform(0.1, 0.2)
    probe_from_image = Rotation.random(random_state=rng).as_matrix()
    offset = rng.uniform(-100, 100, 3)
    upright = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)).as_matrix()
    flip = np.diag([rng.choice([-1.0, 1.0]), 1.0, 1.0])
    points, frame, truth, seen = [], [], [], []
    for number in range(frames):
        turned = Rotation.from_rotvec(rng.normal(scale=turn_rad, size=3)).as_matrix() @ upright
        place = rng.uniform(-1, 1, 3) * shift_mm
        # The phantom in the image's frame, mm, about the middle of the image.
        ends = wires @ turned.T + place
        along = ends[:, 1] - ends[:, 0]
        px = _cross(ends, along)[:, :2] / scale + IMAGE_PX / 2
        inside = ((px > 0) & (px < IMAGE_PX)).all(axis=1)
        px = (px + rng.normal(scale=sigma_px, size=px.shape) - IMAGE_PX / 2) @ flip[:2, :2] + IMAGE_PX / 2
        wrong = Rotation.from_rotvec(rng.normal(scale=sigma_rad, size=3)).as_matrix()
        tracked = ends @ wrong.T + rng.normal(scale=sigma_mm, size=3)
        points.append(px[inside])
        truth.append(np.flatnonzero(inside))
        frame.append(np.full(int(inside.sum()), number))
        seen.append(tracked @ probe_from_image.T + offset)
    return Dots(np.concatenate(points), np.concatenate(frame), np.concatenate(truth), np.array(seen))


def scan_volumes(
    rng,
    wires,
    frames,
    *,
    turn_rad=0.25,
    shift_mm=(8.0, 8.0, 8.0),
    sigma_px=0.7,
    sigma_mm=0.3,
    sigma_rad=0.003,
):
    """What a 3D probe sees of a phantom: lines, two points on each, where a wire is within a box of the view."""
    view = _View(rng, sigma_px, sigma_mm, sigma_rad)
    for number in range(frames):
        turned = Rotation.from_rotvec(rng.normal(scale=turn_rad, size=3)).as_matrix() @ view.upright
        view.add(number, wires @ turned.T + rng.uniform(-1, 1, 3) * shift_mm)
    return view.dots()


def scan_needles(
    rng, count, frames, *, volumes=False, seen=0.9, sigma_px=1.0, sigma_mm=0.3, sigma_rad=0.003, wires=None
):
    """Needles that move one without the other, each tracked, beside wires or none; seen in a part of the images."""
    view = _View(rng, sigma_px, sigma_mm, sigma_rad)
    for number in range(frames):
        tilts = np.column_stack([rng.normal(scale=0.4, size=(count, 2)), np.ones(count)])
        tilts /= np.linalg.norm(tilts, axis=1, keepdims=True)
        if volumes:  # they lie across the view
            tilts = tilts[:, [2, 0, 1]]
        middle = rng.uniform(-0.35, 0.35, (count, 3)) * IMAGE_PX * view.scale * [1, 1, float(volumes)]
        ends = np.stack([middle - 60 * tilts, middle + 60 * tilts], axis=1)
        if wires is not None:
            turned = Rotation.from_rotvec(rng.normal(scale=0.25, size=3)).as_matrix() @ view.upright
            ends = np.concatenate([ends, wires @ turned.T + rng.uniform(-8, 8, 3)])
        add = view.add if volumes else view.add_dots
        add(number, ends, seen)
    return view.dots()


class _View:
    """A probe, and what it has seen so far."""

    def __init__(self, rng, sigma_px, sigma_mm, sigma_rad):
        self.sigma_px, self.sigma_mm, self.sigma_rad = sigma_px, sigma_mm, sigma_rad
        self.rng, self.scale = rng, rng.uniform(0.1, 0.2)
        self.probe_from_image = Rotation.random(random_state=rng).as_matrix()
        self.offset = rng.uniform(-100, 100, 3)
        self.upright = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)).as_matrix()
        self.points, self.frame, self.truth, self.wires = [], [], [], []

    def add(self, number, ends, seen=1.0):
        """Lines of a volume, mm about its middle: the parts within a cube."""
        half = IMAGE_PX * self.scale / 2
        start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = (np.array([-half, half])[:, None, None] - start) / along
        enter = np.maximum(np.nanmax(shares.min(axis=0), axis=1), 0.0)
        leave = np.minimum(np.nanmin(shares.max(axis=0), axis=1), 1.0)
        length = (leave - enter) * np.linalg.norm(along, axis=1)
        inside = (length > half / 2) & (self.rng.random(len(ends)) < seen)
        parts = np.stack([start + enter[:, None] * along, start + leave[:, None] * along], axis=1)[inside]
        px = parts / self.scale + IMAGE_PX / 2
        self._keep(number, ends, px, inside)

    def add_dots(self, number, ends, seen=1.0):
        """Where lines cross an image."""
        px = _cross(ends, ends[:, 1] - ends[:, 0])[:, :2] / self.scale + IMAGE_PX / 2
        inside = ((px > 0) & (px < IMAGE_PX)).all(axis=1) & (self.rng.random(len(ends)) < seen)
        px = px[inside]
        self._keep(number, ends, px, inside)

    def _keep(self, number, ends, px, inside):
        """As they are tracked, with an error that a frame's lines share."""
        wrong = Rotation.from_rotvec(self.rng.normal(scale=self.sigma_rad, size=3)).as_matrix()
        tracked = ends @ wrong.T + self.rng.normal(scale=self.sigma_mm, size=3)
        self.points.append(px + self.rng.normal(scale=self.sigma_px, size=px.shape))
        self.truth.append(np.flatnonzero(inside))
        self.frame.append(np.full(int(inside.sum()), number))
        self.wires.append(tracked @ self.probe_from_image.T + self.offset)

    def dots(self):
        """All of it."""
        together = (np.concatenate(one) for one in (self.points, self.frame, self.truth))
        return Dots(*together, np.array(self.wires))


def _cross(ends, along):
    """Where wires cross the image."""
    return ends[:, 0] - (ends[:, 0, 2] / along[:, 2])[:, None] * along


def spoilt(rng, dots, removed, false):
    """Some dots removed, and others added that are of no wire, as many as that part of what is left."""
    keep = rng.random(len(dots.points)) >= removed
    points, frame, truth = dots.points[keep], dots.frame[keep], dots.truth[keep]
    low, high = dots.points.min(axis=0), dots.points.max(axis=0)
    count = round(false * len(points))
    points = np.concatenate([points, rng.uniform(low, high, (count, *points.shape[1:]))])
    frame = np.concatenate([frame, rng.integers(0, len(dots.wires), count)])
    truth = np.concatenate([truth, np.full(count, -1)])
    order = rng.permutation(len(points))
    return Dots(points[order], frame[order], truth[order], dots.wires)
