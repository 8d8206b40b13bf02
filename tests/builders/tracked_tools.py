"""Poses of tools that are turned as people turn them."""

import numpy as np
from scipy.spatial.transform import Rotation

TIP = np.array([-18.0, 2.0, -157.0])


AXIS = np.array([0.1, -0.2, 0.97]) / np.linalg.norm([0.1, -0.2, 0.97])


def pivoting(rng, n=200, tilt_deg=30.0, noise_mm=0.2, tip=TIP):
    """A tool tilted to all sides about its resting tip."""
    base = Rotation.random(random_state=rng)
    # A hand moves smoothly: tilts follow slow waves.
    t = np.linspace(0, 12, n)
    tilts = np.radians(tilt_deg) * np.column_stack([np.sin(t), np.cos(1.3 * t), np.sin(0.7 * t)])
    matrices = np.tile(np.eye(4), (n, 1, 1))
    matrices[:, :3, :3] = (base * Rotation.from_rotvec(tilts)).as_matrix()
    matrices[:, :3, 3] = (
        np.array([100, -50, -1000]) - matrices[:, :3, :3] @ tip + rng.normal(0, noise_mm, (n, 3))
    )
    return matrices


def spinning(rng, n=200, turn_deg=150.0, wobble_deg=0.1, axis=AXIS, point=TIP, noise_mm=0.0):
    """A tool spun about an axis that rests."""
    base = Rotation.random(random_state=rng)
    spin = Rotation.from_rotvec(np.radians(np.linspace(-turn_deg, turn_deg, n))[:, None] * axis)
    wobble = Rotation.from_rotvec(rng.normal(0, np.radians(wobble_deg), (n, 3)))
    matrices = np.tile(np.eye(4), (n, 1, 1))
    matrices[:, :3, :3] = (base * wobble * spin).as_matrix()
    matrices[:, :3, 3] = np.array([10, 20, -900]) - matrices[:, :3, :3] @ point
    matrices[:, :3, 3] += rng.normal(0, noise_mm, (n, 3))
    return matrices
