"""Correspondences of every kind, of a similarity with known truth."""

import numpy as np

from sonocal import registration as reg
from sonocal.geometry import Similarity

# As many of each kind as determine a similarity, with one to spare.
ENOUGH = {
    "point_plane": 8,
    "point_line": 5,
    "plane_points_line": 6,
    "point_point": 4,
    "line_line": 3,
    "line_plane": 5,
    "plane_plane": 5,
}


def truth(random: np.random.Generator) -> Similarity:
    return Similarity.from_rotvec(
        random.normal(size=3), random.uniform(-100, 100, 3), float(random.uniform(0.05, 2))
    )


def planes_through(places, random, along=None):
    normals = (
        random.normal(size=places.shape)
        if along is None
        else np.cross(along, random.normal(size=along.shape))
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.column_stack([normals, -np.einsum("ij,ij->i", normals, places)])


def correspondences(kind: str, count: int, true: Similarity, random, noise: float = 0.0) -> reg.Rows:
    """Noise in mm moves what is in the target."""
    points = random.uniform(0, 500, (count, 3))
    if kind == "plane_points_line":
        points[:, 2] = 0
    ends = random.uniform(0, 500, (count, 2, 3))
    places = true @ points + noise * random.normal(size=points.shape)
    lines = (true @ ends.reshape(-1, 3)).reshape(ends.shape) + noise * random.normal(size=ends.shape)
    if kind == "point_plane":
        return reg.point_plane(points, planes_through(places, random))
    if kind in ("point_line", "plane_points_line"):
        along = random.normal(size=places.shape)
        return reg.point_line(points, np.stack([places - 20 * along, places + 30 * along], axis=1))
    if kind == "point_point":
        return reg.point_point(points, places)
    if kind == "line_line":
        return reg.line_line(ends, lines)
    if kind == "line_plane":
        return reg.line_plane(ends, planes_through(lines[:, 0], random, along=lines[:, 1] - lines[:, 0]))
    source = planes_through(points, random)
    normals = source[:, :3] @ true.rotation.T
    target = np.column_stack([normals, -np.einsum("ij,ij->i", normals, places)])
    return reg.plane_plane(source, target, size=100.0)
