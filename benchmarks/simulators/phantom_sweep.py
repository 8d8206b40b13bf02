"""A hand-led sweep over a phantom of wires that stands anywhere, with which dot is of which wire known.

NumPy and SciPy alone: what judges an estimator shares nothing with it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

IMAGE_PX, SCALE = np.array([600.0, 500.0]), 0.2
# Wires of two N in two layers, and one that crosses below: ends in the phantom's frame, mm.
N_WIRES = np.array(
    [
        *([[0, 0, 0], [0, 40, 0]], [[20, 0, 0], [40, 40, 0]], [[60, 0, 0], [60, 40, 0]]),
        *([[5, 0, -20], [5, 40, -20]], [[50, 0, -20], [15, 40, -20]], [[65, 0, -20], [65, 40, -20]]),
        *([[10, 0, -35], [55, 40, -30]],),
    ],
    dtype=float,
)
THREE = N_WIRES[[1, 4, 6]]
PARALLEL = N_WIRES[[0, 2, 3, 5]]


@dataclass(frozen=True, eq=False)
class PhantomSweep:
    """What was seen, and the truth.

    Attributes:
        points_px: (N, 2).
        poses: (N, 4, 4): the frame that the phantom is fixed to in the probe marker's, as tracked.
        frame, wire: (N,): the image, and which wire.
        truth: (4, 4): probe from image.
        place: (4, 4): fixed_to from phantom.
        wires: (W, 2, 3): as they truly are, in the phantom's frame.
    """

    points_px: np.ndarray
    poses: np.ndarray
    frame: np.ndarray
    wire: np.ndarray
    truth: np.ndarray
    place: np.ndarray
    wires: np.ndarray


def phantom_sweep(
    seed,
    wires=N_WIRES,
    *,
    frames=60,
    px=1.0,
    mm=0.3,
    deg=0.2,
    tilt_deg=25.0,
    turn_deg=25.0,
    wrong=0.0,
    shape_mm=0.0,
    tracked=False,
):
    """A sweep; wires are off by `shape_mm` at either end, which nobody says."""
    rng = np.random.default_rng(seed)
    truth, place = _pose(rng, 60), _pose(rng, 300)
    truth[:3, :3] *= SCALE
    real = wires + rng.normal(0, 1, wires.shape) * shape_mm
    middle = real.reshape(-1, 3).mean(axis=0)
    points, poses, frame, wire = [], [], [], []
    for i in range(frames):
        # The image stands across the wires; a hand tilts it about two axes, turns it, and shifts it.
        upright = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]).T
        tilts = np.radians(rng.uniform(-1, 1, 3) * [tilt_deg, tilt_deg, turn_deg])
        turn = Rotation.from_euler("xyz", tilts).as_matrix() @ upright
        at = middle + rng.uniform(-1, 1, 3) * [8, 14, 6]
        phantom_from_image = np.eye(4)
        phantom_from_image[:3, :3] = turn * SCALE
        phantom_from_image[:3, 3] = at - turn @ np.array([*IMAGE_PX / 2, 0]) * SCALE
        probe_from_fixed = truth @ np.linalg.inv(phantom_from_image) @ np.linalg.inv(place)
        shown = _shaken(rng, np.eye(4), mm, deg) @ probe_from_fixed
        if tracked:
            shown = shown @ _shaken(rng, np.eye(4), mm, deg)
        for k, (start, end) in enumerate(real):
            ends = np.column_stack([np.stack([start, end]), np.ones(2)]) @ np.linalg.inv(phantom_from_image).T
            share = -ends[0, 2] / (ends[1, 2] - ends[0, 2])
            dot = ends[0, :2] + share * (ends[1, :2] - ends[0, :2])
            if not (0 <= share <= 1 and np.all(dot >= 0) and np.all(dot <= IMAGE_PX)):
                continue
            seen = rng.uniform(0, IMAGE_PX) if rng.random() < wrong else dot + rng.normal(0, px, 2)
            points.append(seen)
            poses.append(shown)
            frame.append(i)
            wire.append(k)
    return PhantomSweep(
        np.array(points), np.array(poses), np.array(frame), np.array(wire), truth, place, real
    )


def _pose(rng, reach):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.normal(0, reach, 3)
    return pose


def _shaken(rng, pose, mm, deg):
    shake = np.eye(4)
    shake[:3, :3] = Rotation.from_rotvec(np.radians(deg) * rng.normal(size=3)).as_matrix()
    shake[:3, 3] = mm * rng.normal(size=3)
    return shake @ pose
