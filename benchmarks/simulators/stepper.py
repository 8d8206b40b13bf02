"""A stepper that turns a probe about one axis and moves it along another, with a tracker's noise."""

import numpy as np
from scipy.spatial.transform import Rotation


def stepper(
    seed, *, tilt_deg=0.0, turn_deg=90.0, travel_mm=60.0, mm=0.3, deg=0.05, play_deg=0.02, frames=150
):
    """Poses of the probe as it is turned, and as it is moved along.

    Returns:
        rotation and translation (frames, 4, 4), and the truth in the marker's frame: axis, a point of it, translation.
    """
    rng = np.random.default_rng(seed)
    base, mount = _pose(rng, 300), _pose(rng, 80)
    side = _unit(np.cross([0.0, 0, 1], rng.normal(size=3)))
    tilted = Rotation.from_rotvec(np.radians(tilt_deg) * side).apply([0.0, 0, 1])

    def marker(angle, way):
        turned = np.eye(4)
        play = Rotation.from_rotvec(np.radians(play_deg) * rng.normal(size=3))
        turned[:3, :3] = (play * Rotation.from_rotvec(angle * np.array([0.0, 0, 1]))).as_matrix()
        turned[:3, 3] = way * tilted
        pose = base @ turned @ mount
        pose[:3, :3] = Rotation.from_rotvec(np.radians(deg) * rng.normal(size=3)).as_matrix() @ pose[:3, :3]
        pose[:3, 3] += mm * rng.normal(size=3)
        return pose

    angles = np.radians(turn_deg) * (np.linspace(0, 1, frames) - 0.5)
    rotation = np.array([marker(angle, 10.0) for angle in angles])
    translation = np.array([marker(0.2, way) for way in travel_mm * np.linspace(0, 1, frames)])
    inverse = np.linalg.inv(mount)
    # Of the translation at the angle at which it was made.
    held = Rotation.from_rotvec([0, 0, -0.2]).apply(tilted)
    return rotation, translation, (inverse[:3, 2], inverse[:3, 3], inverse[:3, :3] @ held)


def _pose(rng, reach):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.normal(0, reach, 3)
    return pose


def _unit(vector):
    return vector / np.linalg.norm(vector)
