"""A session in which a stylus is dragged along faces and edges of a block, and touches some divots of it.

Shares nothing with what finds the drags: strokes of a hand on the true block, smooth ways with a slow wander through
the air between them; the tracker's noise is on the marker. Faces and edges are off by what printing does to them.
"""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

RATE_HZ = 20.0
TIP = np.array([12.0, -4.0, -110.0])
# A wedge-like block with a slanted roof: nothing of it is symmetric. Corners of its faces, outward; and some edges.
FACES = {
    "front": np.array([[0.0, 0, 0], [90, 0, 0], [90, 0, 40]]),
    "left": np.array([[0.0, 0, 0], [0, 0, 50], [0, 60, 50]]),
    "roof": np.array([[0.0, 0, 50], [90, 0, 40], [0, 60, 50]]),
    "back": np.array([[0.0, 60, 0], [90, 60, 40], [90, 60, 0]]),
}
EDGES = {
    "left edge": np.array([[0.0, 0, 50], [0, 60, 50]]),
    "right edge": np.array([[90.0, 0, 40], [90, 60, 40]]),
    "front edge": np.array([[0.0, 0, 50], [90, 0, 40]]),
}
DIVOTS = np.array([[10.0, 10, 48.9], [80, 12, 41.1], [75, 50, 41.7], [15, 48, 48.3]])
MIDDLE = np.array([45.0, 30, 22])


def drag_session(
    rng,
    order=("front", "left", "roof", "left edge", 0, 1),
    *,
    seconds=(4.0, 8.0),
    tracker_mm=0.3,
    shape_mm=0.15,
    lost=0.05,
    false=1,
    pace_mm_s=40.0,
):
    """One session.

    Args:
        rng: numpy's.
        order: names of faces and edges, numbers of divots.
        seconds: of each.
        tracker_mm: noise of the marker's place along every axis; it turns by 0.05 deg.
        shape_mm: of the tip off a face or edge: what a face is off as a whole, and again its roughness.
        lost: share of poses.
        false: rests in the air.
        pace_mm_s: of strokes.

    Returns:
        times (N,), reference_from_stylus (N, 4, 4), reference_from_phantom (4, 4), and for each of the order its items.
    """
    truth = np.eye(4)
    truth[:3, :3], truth[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-200, 200, 3)
    items, ways, leans = [*order], [], []
    for _ in range(false):
        items.insert(int(rng.integers(0, len(items) + 1)), None)
    for one in items:
        way, lean = _way(rng, one, rng.uniform(*seconds), shape_mm, pace_mm_s)
        ways.append(way)
        leans.append(lean)
    places, shafts, spans = [], [], []
    count = 0
    for k, way in enumerate(ways):
        if k:
            air = _air(rng, ways[k - 1][-1], way[0], leans[k - 1], leans[k])
            places.append(air)
            shafts.append(np.linspace(leans[k - 1], leans[k], len(air)))
            count += len(air)
        places.append(way)
        shafts.append(np.tile(leans[k], (len(way), 1)))
        if items[k] is not None:
            spans.append((items[k], count, count + len(way) - 1))
        count += len(way)
    tips, shaft = np.vstack(places), np.vstack(shafts)
    facing = _facing(rng, shaft)
    stylus = np.tile(np.eye(4), (len(tips), 1, 1))
    noisy = facing * Rotation.from_rotvec(rng.normal(0, np.radians(0.05), (len(tips), 3)))
    stylus[:, :3, :3] = noisy.as_matrix()
    stylus[:, :3, 3] = tips - facing.apply(TIP) + rng.normal(0, tracker_mm, tips.shape)
    stylus = truth @ stylus
    stylus[rng.random(len(tips)) < lost] = np.nan
    return np.arange(len(tips)) / RATE_HZ, stylus, truth, spans


def _way(rng, one, seconds, shape_mm, pace):
    """Places of the tip in the phantom's frame, and where the shaft leans to from there."""
    n = int(RATE_HZ * seconds)
    if one is None or isinstance(one, (int, np.integer)):
        at = (
            MIDDLE + rng.normal(0, 60, 3) + [0, 0, 90]
            if one is None
            else DIVOTS[one] + rng.normal(0, shape_mm, 3)
        )
        return np.tile(at, (max(n // 2, 30), 1)), _tilted(rng, np.array([0.0, 0, 1]))
    if one in EDGES:
        start, end = EDGES[one]
        lean = _tilted(rng, _unit(0.5 * (start + end) - MIDDLE))
        length = np.linalg.norm(end - start)
        share = _strokes(rng, n, length, pace, 1)[:, 0]
        off = rng.normal(0, shape_mm, 3) + rng.normal(0, shape_mm / 2, (n, 3))
        return start + (0.08 + 0.84 * share)[:, None] * (end - start) + off, lean
    corners = FACES[one]
    normal = _unit(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
    normal = normal if normal @ (corners[0] - MIDDLE) > 0 else -normal
    along = _unit(corners[1] - corners[0])
    beside = np.cross(normal, along)
    reach = [np.abs((corners - corners.mean(axis=0)) @ a).max() for a in (along, beside)]
    share = _strokes(rng, n, 2 * reach[0], pace, 2) - 0.5
    flat = corners.mean(axis=0) + 1.2 * (share[:, :1] * reach[0] * along + share[:, 1:] * reach[1] * beside)
    # As a whole off by a shift and a tilt, and rough.
    off = rng.normal(0, shape_mm) + share @ rng.normal(0, shape_mm, 2) + rng.normal(0, shape_mm / 2, n)
    return flat + off[:, None] * normal, _tilted(rng, normal)


def _strokes(rng, n, length, pace, axes):
    """(n, axes): shares of the sides at which a hand is that goes to and fro, over a face as one hatches it."""
    t = np.cumsum(rng.uniform(0.7, 1.3, n)) / RATE_HZ
    turns = pace / max(length, 1.0) / 2 * np.array([0.6, 1.9] if axes == 2 else [1.0])
    phase = rng.uniform(0, 1, axes)
    return 0.5 + 0.5 * np.sin(2 * np.pi * (t[:, None] * turns + phase))


def _air(rng, start, end, lean, next_lean):
    """From one to the next: up, across and down, with a hand's slow wander."""
    n = int(RATE_HZ * rng.uniform(1.2, 3.0))
    s = np.linspace(0, 1, n, endpoint=False)[1:]
    share = s**3 * (10 - 15 * s + 6 * s**2)
    up = 60 * (lean * (1 - s[:, None]) + next_lean * s[:, None])
    lift = np.sin(np.pi * s)[:, None] ** 0.8 * up * rng.uniform(0.5, 1.2)
    wander = rng.normal(0, 4, (3, 3)) @ np.sin(np.pi * np.outer([1, 2, 3], s))
    return start + share[:, None] * (end - start) + lift + wander.T


def _facing(rng, shaft):
    """Rotations whose tip's way is along the shafts, with a hand's turns."""
    from_tip = -TIP / np.linalg.norm(TIP)
    keys = np.arange(0, len(shaft) + 10, 10)
    rotations = []
    for k in np.minimum(keys, len(shaft) - 1):
        axis = np.cross(from_tip, shaft[k])
        angle = np.arctan2(np.linalg.norm(axis), from_tip @ shaft[k])
        rotations.append(
            Rotation.from_rotvec(angle * _unit(axis)) * Rotation.from_rotvec(rng.normal(0, 0.04, 3))
        )
    return Slerp(keys, Rotation.concatenate(rotations))(np.arange(len(shaft)))


def _tilted(rng, normal):
    return _unit(normal + 0.45 * _unit(rng.normal(0, 1, 3)))


def _unit(vector):
    return vector / np.linalg.norm(vector)
