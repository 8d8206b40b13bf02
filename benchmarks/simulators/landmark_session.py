"""A session in which a stylus touches the landmarks of a phantom: tremor, noise, lost poses, touches of nothing."""

import numpy as np
from scipy.spatial.transform import Rotation

RATE_HZ = 20.0
TIP = np.array([12.0, -4.0, -110.0])
# Like the blocks that PLUS's users have: eight divots in its sides.
EIGHT = np.array(
    [
        *([104.3, 5, 20], [104.3, 45, 20], [104.3, 45, 0], [104.3, -5, 0]),
        *([-34.3, 45, 15], [-34.3, -5, 20], [-34.3, -5, 0], [-34.3, 45, 0]),
    ],
    dtype=float,
)
BOX = np.array([[x, y, z] for x in (0, 80) for y in (0, 60) for z in (0, 40)], dtype=float)


def session(
    rng,
    landmarks=EIGHT,
    order=None,
    *,
    false=2,
    seconds=(1.0, 10.0),
    tremor_mm=0.3,
    tracker_mm=0.3,
    seat_mm=0.2,
    lost=0.1,
    tip_error_mm=0.0,
):
    """One session.

    Returns:
        times (N,), reference_from_stylus (N, 4, 4) with NaN where a pose was lost, reference_from_phantom (4, 4), and
        which landmark was touched in which order (-1: none).
    """
    truth = np.eye(4)
    truth[:3, :3], truth[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-200, 200, 3)
    order = rng.permutation(len(landmarks)) if order is None else np.asarray(order)
    order = list(order)
    for _ in range(false):
        order.insert(int(rng.integers(0, len(order) + 1)), -1)
    middle, reach = landmarks.mean(axis=0), np.ptp(landmarks, axis=0).max()
    stops = []
    for k in order:
        place = middle + rng.uniform(-1, 1, 3) * reach if k < 0 else landmarks[k] + rng.normal(0, seat_mm, 3)
        stops.append(truth[:3, :3] @ place + truth[:3, 3])
    tips, facing, resting = _path(rng, stops, seconds)
    n = len(tips)
    tips = tips + _coloured(rng, n, tremor_mm) * resting[:, None]
    tips = tips + _coloured(rng, n, 3.0) * ~resting[:, None]
    stylus = np.tile(np.eye(4), (n, 1, 1))
    # A marker is seen to a twentieth of a degree.
    stylus[:, :3, :3] = (facing * Rotation.from_rotvec(rng.normal(0, np.radians(0.05), (n, 3)))).as_matrix()
    true_tip = TIP + tip_error_mm * np.array([0.6, 0.0, 0.8])
    stylus[:, :3, 3] = tips - facing.apply(true_tip) + rng.normal(0, tracker_mm, (n, 3))
    gone = rng.random(n) < lost / 2
    while gone.mean() < lost:
        at = int(rng.integers(0, n))
        gone[at : at + int(rng.integers(2, 12))] = True
    stylus[gone] = np.nan
    return np.arange(n) / RATE_HZ, stylus, truth, np.array(order)


def _path(rng, stops, seconds):
    """Places of the tip, how the stylus faces, and whether the tip rests."""
    tips, turns, resting = [], [], []
    base = Rotation.random(random_state=rng)
    here = stops[0] + rng.normal(0, 80, 3)
    for stop in stops:
        n = int(RATE_HZ * rng.uniform(1.0, 2.5))
        s = np.linspace(0, 1, n, endpoint=False)
        share = s**3 * (10 - 15 * s + 6 * s**2)
        lift = rng.normal(0, 30, 3)
        tips.append(here + share[:, None] * (stop - here) + np.sin(np.pi * s)[:, None] ** 2 * lift)
        turns.append(np.zeros((n, 3)))
        resting.append(np.zeros(n, dtype=bool))
        m = int(RATE_HZ * rng.uniform(*seconds))
        tips.append(np.tile(stop, (m, 1)))
        t = np.arange(m) / RATE_HZ
        swing = np.radians(rng.uniform(3, 20)) * np.sin(np.pi * np.minimum(t, t[-1] - t + 1e-9) / 2)[:, None]
        phase = 2 * np.pi * rng.uniform(0.2, 0.5) * t
        turns.append(np.column_stack([np.cos(phase), np.sin(phase), 0.3 * np.sin(2 * phase)]) * swing)
        resting.append(np.ones(m, dtype=bool))
        here = stop
    wander = _coloured(rng, sum(map(len, tips)), np.radians(3), 0.2)
    facing = base * Rotation.from_rotvec(np.vstack(turns) + wander)
    return np.vstack(tips), facing, np.concatenate(resting)


def _coloured(rng, n, deviation, memory_s=0.05):
    """(n, 3): a hand's motion, forgotten in so many seconds."""
    keep = np.exp(-1 / (RATE_HZ * memory_s))
    drive = rng.normal(0, np.sqrt(1 - keep**2), (n, 3))
    drive[0] = rng.normal(0, 1, 3)
    for i in range(1, n):
        drive[i] += keep * drive[i - 1]
    return deviation * drive
