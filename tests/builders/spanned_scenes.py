"""Points of a source on points, lines and planes that other points span, with noise on both sides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from sonocal.geometry import Array, Similarity
from sonocal.registration.spanned import SpannedRows, joined_spanned, spanned

# How many points of the image, and how many that span the target.
KINDS = {
    "point": (1, 1),
    "point on line": (1, 2),
    "point on plane": (1, 3),
    "line": (2, 2),
    "four points of a line": (4, 2),
    "line on plane": (2, 3),
    "plane": (3, 3),
}


def scene(
    kinds: Sequence[str], count: int, seed: int, *, px: float = 1.0, mm: float = 1.0, flat: bool = False
) -> tuple[Similarity, SpannedRows]:
    """So many sightings of each kind, of a volume or of a flat image."""
    random = np.random.default_rng(seed)
    truth = Similarity(Rotation.random(rng=random).as_matrix(), random.uniform(-100, 100, 3), 0.24)
    parts = []
    for kind in kinds:
        seen, spans = KINDS[kind]
        points = random.uniform(0, 500, (count, seen, 3)) * [1, 1, 0 if flat else 1]
        if seen > 2:  # on one line, or in one plane as they are
            points = _straight(points) if spans == 2 else points
        there = truth @ points.reshape(-1, 3)
        targets = _targets(there.reshape(count, seen, 3), spans, random)
        noise = px * random.normal(size=points.shape) * [1, 1, 0 if flat else 1]
        parts.append(spanned(points + noise, targets + mm * random.normal(size=targets.shape)))
    rows = joined_spanned(parts)
    assert rows is not None
    return truth, rows


def _straight(points: Array) -> Array:
    shares = np.linspace(0, 1, points.shape[1])[None, :, None]
    return points[:, :1] + shares * (points[:, 1:2] - points[:, :1])


def _targets(places: Array, spans: int, random: np.random.Generator) -> Array:
    """(C, spans, 3): points about the places that span what they lie on."""
    count, seen = places.shape[:2]
    first, along = places[:, 0], random.normal(size=(count, 2, 3))
    if seen > 1:
        along[:, 0] = places[:, -1] - first
    if seen > 2:
        along[:, 1] = places[:, 1] - first
    axes = np.linalg.qr(along.transpose(0, 2, 1))[0].transpose(0, 2, 1)
    reach = random.uniform(50, 150, (count, 3, 1))
    if spans == 1:
        return first[:, None]
    if spans == 2:
        return np.stack([first - reach[:, 0] * axes[:, 0], first + reach[:, 1] * axes[:, 0]], axis=1)
    angles = 2 * np.pi / 3 * np.arange(3) + random.uniform(0, 2 * np.pi, (count, 1))
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return first[:, None] + reach * (around @ axes)
