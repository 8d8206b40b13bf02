"""A probe that a hand leads over a thread, a cross or a floor, steadily in time, with a tracker that lags."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.simulators.mixes import Array
from benchmarks.simulators.places import SPANS, Noise, Sweep, shaken
from benchmarks.simulators.places_hand import IMAGE_PX, Kind, directions, image_home, in_image

__all__ = ["tank_sweep"]

RATE_HZ = 20.0
SCALE = 0.2
# Of the hand's turns and shifts, s.
PERIODS = (3.1, 4.3, 5.7, 7.9)


def tank_sweep(
    kind: Kind,
    seed: int,
    *,
    lag_s: float = 0.0,
    frames: int = 300,
    noise: Noise | None = None,
    tilt_deg: float = 40.0,
) -> tuple[Sweep, Array]:
    """Rows of a steady motion, and the time of each; its poses are those of `lag_s` before.

    Args:
        kind: of target; a floor shows two points an image.
        seed: of everything.
        lag_s: the tracker's stamps are later than the images'.
        frames: how many, at 20 a second.
        noise: none: exact.
        tilt_deg: the image's largest tilt, of each of two.
    """
    random = np.random.default_rng([seed, frames, SPANS[kind]])
    truth = np.eye(4)
    truth[:3, :3] = SCALE * Rotation.random(random_state=random.integers(2**31)).as_matrix()
    truth[:3, 3] = random.normal(size=3) * 15 - truth[:3, :3] @ np.array([*IMAGE_PX, 0]) * 0.5
    truth[:3, 3] += truth[:3, 1] / SCALE * 80
    along, across = directions(kind, random)
    middle = random.normal(size=3) * 200 + [0, 0, -1200]
    waves = random.uniform(0, 2 * np.pi, (7, len(PERIODS)))
    times = np.arange(frames) / RATE_HZ
    points, poses = _led(kind, truth, (middle, along, across), _smooth(times, waves), tilt_deg)
    late = _led(kind, truth, (middle, along, across), _smooth(times - lag_s, waves), tilt_deg)[1]
    if noise is not None:
        late = shaken(late, noise, random)
        points = points + random.normal(size=points.shape) * noise.px * np.r_[1, 1, 0]
    rows = np.repeat(np.arange(frames), points.shape[1])
    place = np.array([middle, middle + 50 * along, middle + 50 * across])[: SPANS[kind]]
    wrong = np.zeros(len(rows), dtype=bool)
    scene = Sweep(points.reshape(-1, 3), late[rows], rows, truth, poses[rows], place, False, wrong, 2)
    return scene, times[rows]


def _smooth(times: Array, waves: Array) -> Array:
    """(F, 7): of -1 to 1, that never repeat."""
    periods = 2 * np.pi / np.array(PERIODS)
    return np.asarray(np.sin(times[:, None, None] * periods + waves).mean(axis=2) * 1.6).clip(-1, 1)


def _led(
    kind: Kind, truth: Array, target: tuple[Array, Array, Array], hand: Array, tilt_deg: float
) -> tuple[Array, Array]:
    """Pixels (F, each, 3), and poses (F, 4, 4) of the room in the probe marker's frame."""
    middle, along, across = target
    yaw = np.deg2rad(45.0 if kind == "line" else 180.0) * hand[:, 0]
    tilts = np.deg2rad(tilt_deg) * hand[:, 1:3]
    image = Rotation.from_euler("zxy", np.column_stack([yaw, tilts])).as_matrix() @ image_home(along)
    pixel = np.column_stack([np.array(IMAGE_PX) * (0.5 + 0.35 * hand[:, 3:5]), np.zeros(len(hand))])
    there = (
        middle
        + 40 * (kind != "point") * hand[:, 5:6] * along
        + 40 * (kind == "plane") * hand[:, 6:7] * across
    )
    poses = np.tile(np.eye(4), (len(hand), 1, 1))  # tracker from probe
    poses[:, :3, :3] = image @ truth[:3, :3].T / SCALE
    seen = pixel @ truth[:3, :3].T + truth[:3, 3]
    poses[:, :3, 3] = there - np.einsum("nij,nj->ni", poses[:, :3, :3], seen)
    shown = pixel[:, None]
    if kind == "plane":
        step = 100.0 * np.array([in_image(kind, one, along, across) for one in image])[:, None]
        shown = np.concatenate([shown - step, shown + step], axis=1)
    return shown, np.linalg.inv(poses)
