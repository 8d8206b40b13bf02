"""A set of wires onto itself: turns, mirrors and inversions that leave nearly every wire where one was."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np

from sonocal.geometry import Array

__all__ = ["near_isometries", "symmetry_named"]

# Wires that a motion brings within this distance of wires, on average: a scan may take them for one another.
NEAR_MM = 2.5
# A motion that moves wires by less is none.
STILL_MM = 3.0
PARALLEL_DEG = 5.0
SAME_ANGLE_DEG = 5.0
# Motions nearer to one another than that are one.
SAME = 0.1


def near_isometries(wires: Array) -> list[tuple[str, Array]]:
    """Motions of a set of wires onto itself, with or without a mirror, but for the one that moves nothing.

    Two wires that are farthest from parallel are put onto every two that lie alike; what brings the others near
    wires, too, is one.

    Args:
        wires: (L, 2, 3), mm: two points on each, at the ends of what is scanned.

    Returns:
        Names, such as "a half turn", and (4, 4) matrices, mm, the nearest first.
    """
    if len(wires) < 2:
        return []
    parallel, pair = _reference(wires)
    start = _corner(wires, pair, (1, 1), parallel)
    if start is None:
        return []
    found: list[tuple[float, Array]] = []
    for motion in _motions(wires, start, parallel):
        moved = wires @ motion[:3, :3].T + motion[:3, 3]
        error = _off(moved, wires)
        if error > NEAR_MM or _mean_distance(moved, wires) < STILL_MM:
            continue
        if all(np.abs(motion - other)[:3, :3].max() > SAME for _, other in found):
            found.append((error, motion))
    found.sort(key=lambda one: one[0])
    return [(symmetry_named(motion), motion) for _, motion in found]


def symmetry_named(motion: Array) -> str:
    """What a motion (4, 4) is called: by its turn's angle, and whether it mirrors."""
    turn = motion[:3, :3]
    proper = bool(np.linalg.det(turn) > 0)
    angle = float(np.degrees(np.arccos(np.clip((np.trace(turn if proper else -turn) - 1) / 2, -1, 1))))
    if proper:
        return "a shift along the wires" if angle < 2 else f"a turn by {angle:.0f} degrees"
    if angle < 2:
        return "an inversion through a point"
    return "a mirror" if angle > 178 else f"a mirror with a turn by {180 - angle:.0f} degrees"


def _directions(wires: Array) -> Array:
    along = wires[:, 1] - wires[:, 0]
    return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))


def _reference(wires: Array) -> tuple[bool, tuple[int, int]]:
    """Whether all wires are parallel, and the two that are told apart best: by angle, or else by distance."""
    along = _directions(wires)
    sine = np.linalg.norm(np.cross(along[:, None], along[None]), axis=-1)
    parallel = bool(sine.max() < np.sin(np.radians(PARALLEL_DEG)))
    apart = np.linalg.norm(wires.mean(axis=1)[:, None] - wires.mean(axis=1), axis=-1)
    i, j = np.unravel_index(np.argmax(apart if parallel else sine), sine.shape)
    return parallel, (int(i), int(j))


def _corner(
    wires: Array, pair: tuple[int, int], signs: tuple[int, int], parallel: bool
) -> tuple[Array, float, float] | None:
    """(4, 4) axes at two wires, their angle (cosine) and their distance, signed where they are not parallel."""
    along = _directions(wires)
    first, second = signs[0] * along[pair[0]], signs[1] * along[pair[1]]
    here, there = wires[pair[0]].mean(axis=0), wires[pair[1]].mean(axis=0)
    if parallel:
        way = there - here
        way = way - (way @ first) * first
        distance = float(np.linalg.norm(way))
        if distance < STILL_MM / 2:
            return None
        across, origin, angle = way / distance, here, 1.0
    else:
        normal = np.cross(first, second)
        sine = float(np.linalg.norm(normal))
        if sine < np.sin(np.radians(PARALLEL_DEG)):
            return None
        normal = normal / sine
        across, angle = np.cross(normal, first), float(first @ second)
        distance = float((there - here) @ normal)
        origin = here + first * (np.cross(there - here, second) @ normal / sine)
    axes = np.eye(4)
    axes[:3, :3] = np.column_stack([first, across, np.cross(first, across)])
    axes[:3, 3] = origin
    return axes, angle, distance


def _motions(wires: Array, start: tuple[Array, float, float], parallel: bool) -> Iterator[Array]:
    axes, angle, distance = start
    back = np.linalg.inv(axes)
    for pair in permutations(range(len(wires)), 2):
        for signs in product((1, -1), (1,) if parallel else (1, -1)):
            corner = _corner(wires, pair, (signs[0], signs[1]), parallel)
            if corner is None:
                continue
            onto, other_angle, other_distance = corner
            if (
                abs(np.degrees(np.arccos(np.clip(angle, -1, 1)) - np.arccos(np.clip(other_angle, -1, 1))))
                > SAME_ANGLE_DEG
            ):
                continue
            for mirror in (1.0, -1.0):
                held = other_distance if parallel else mirror * other_distance
                if abs(held - distance) <= NEAR_MM * 2:
                    yield onto @ np.diag([1.0, 1.0, mirror, 1.0]) @ back


def _off(moved: Array, wires: Array) -> float:
    """Root mean square distance of moved wires from the wires that they come nearest to, each onto its own."""
    distances = _distances(moved, wires)
    nearest = distances.argmin(axis=1)
    if len(set(nearest.tolist())) < len(wires):
        return float(np.inf)
    return float(np.sqrt(np.mean(distances.min(axis=1) ** 2)))


def _mean_distance(moved: Array, wires: Array) -> float:
    """How far wires are moved from where they were."""
    return float(np.mean(np.diagonal(_distances(moved, wires))))


def _distances(moved: Array, wires: Array) -> Array:
    """(L, L): of the ends of each moved wire from the line of each wire, root mean square."""
    along = _directions(wires)
    away = moved[:, None] - wires[None, :, :1]
    away = away - np.einsum("abei,bi->abe", away, along)[..., None] * along[None, :, None]
    return np.asarray(np.sqrt(np.mean(np.sum(away**2, axis=-1), axis=-1)))
