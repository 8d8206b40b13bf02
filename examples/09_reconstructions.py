"""Two reconstructions of one scene of lines and planes, each in its own unit, most matches wrong; no ultrasound."""

import time

import numpy as np
from scipy.spatial.transform import Rotation

from sonocal import registration as reg
from sonocal.geometry import Similarity

random = np.random.default_rng(0)
truth = Similarity(Rotation.random(random_state=1).as_matrix(), [4.0, -2.0, 1.0], 3.7)


def planes_of(corners):
    """Planes (N, 4) through three points (N, 3, 3) each."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.column_stack([normals, -np.sum(normals * corners[:, 0], axis=1)])


def edges_along(places, along):
    """Edges (N, 2, 3), by two points on either side of a place."""
    return places + random.uniform(0.5, 1, (len(places), 2, 1)) * [[-1], [1]] * along


def walls_along(places, along, across):
    """Walls (N, 3, 3), by three points about a place."""
    reach = random.uniform(0.5, 1, (len(places), 3, 1))
    return places + reach * ([[1], [-1], [0]] * along + [[-1], [-1], [1]] * across)


# One model is in units of its own, the other in metres; no point of an edge or a wall is the same in both.
places = random.uniform(-3, 3, (500, 1, 3))
along, across = random.normal(size=(2, 500, 1, 3))
edges, walls = edges_along(places, along), walls_along(places, along, across)
edges_there, walls_there = edges_along(places, along), walls_along(places, along, across)
edges_there = truth @ edges_there + random.normal(scale=0.003, size=edges_there.shape)
walls_there = truth @ walls_there + random.normal(scale=0.003, size=walls_there.shape)
planes, planes_there = planes_of(walls), planes_of(walls_there)

# What matches by looks is often wrong: three in five have another one's partner.
wrong = np.arange(500) < 300
edges_there[wrong] = np.roll(edges_there[wrong], 1, axis=0)
planes_there[wrong] = np.roll(planes_there[wrong], 1, axis=0)

matches = reg.rows(reg.line_line(edges, edges_there), reg.plane_plane(planes, planes_there))
start = time.perf_counter()
found = reg.register(matches, threshold_mm=0.1)  # in the target's unit: metres here
took = time.perf_counter() - start

similarity, sure = found.target_from_source, np.sqrt(np.diag(found.covariance))
print(found)
print(f"{1000 * took:.1f} ms; {np.count_nonzero(found.inlier)} of {len(found.inlier)} matches agree")
print(f"scale {similarity.scale:.4f} +- {sure[6] * similarity.scale:.4f}; true 3.7")
print(
    "translation",
    np.round(similarity.translation, 3),
    "+-",
    np.round(sure[3:6], 3),
    "; true",
    truth.translation,
)
print("right matches left out:", np.count_nonzero(~found.inlier & ~np.tile(wrong, 2)))
