"""From targets that were each placed by themselves to one phantom of them, and back to where each then is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise, product

import numpy as np

from sonocal.errors import DegenerateGeometryError, NoConsensusError
from sonocal.geometry import Array, Similarity
from sonocal.registration.rigid_group import GroupFit, GroupRows, fit_group, normals_of_span
from sonocal.registration.uncertainty import point_covariance, radius_95
from sonocal.registration.unplaced import Place, Placed
from sonocal.registration.unplaced_motion import MOST_ERROR_MM, TOO_LITTLE, refuse
from sonocal.registration.unplaced_rows import SIGMA_MM, SIGMA_PX

__all__ = ["placed_together", "refuse_free_phantom"]

MOST_SIGNS = 3
LEAST_SINE = 0.1
# Of the largest singular value: below it a motion of the phantom changes nothing.
FREE = 1e-3
# Of starts, those that agree best with what was found; a direction counts by what it does so far away.
TRIED, REACH_MM = 2, 30.0


def placed_together(rows: GroupRows, apart: Placed, threshold_mm: float) -> tuple[Placed, GroupFit, float]:
    """The answer with all targets as one phantom of known shape.

    Args:
        rows: of the phantom's targets, as they were given.
        apart: the answer with each target placed by itself.
        threshold_mm: rows within this distance agree.

    Returns:
        The answer, with the places that follow from the phantom's; its fit; and how much more the phantom's shape
        leaves than places of their own do, a number that the shape holds, in units of the noise's variance: near 1
        where the phantom has that shape.

    Raises:
        NoConsensusError: what was found is no such phantom.
        DegenerateGeometryError: the motion tells the calibration from the phantom's place too little.
    """
    levels = (max(apart.sigma_px, 1e-3), max(apart.sigma_mm, 1e-4))
    fits = [
        fit_group(rows, (apart.marker_from_source, place), levels, threshold_mm, apart.inlier)
        for place in sorted(_starts(rows, apart.places), key=partial(_misfit, rows, apart.places))[:TRIED]
    ]
    fits = [one for one in fits if one.freedom > 0 and np.isfinite(one.covariance).all()]
    if not fits or max(one.inlier.sum() for one in fits) < len(rows.points) / 2:
        agreeing = int(max((one.inlier.sum() for one in fits), default=0))
        raise NoConsensusError(
            f"only {agreeing} of {len(rows.points)} rows agree with a phantom of this shape; check that it is the one "
            "scanned, and that rows are matched to its wires by their names",
            best_count=agreeing,
        )
    best = min(fits, key=lambda one: float(np.sum(np.minimum(one.residuals_mm, threshold_mm) ** 2)))
    tangent = len(best.covariance) - 6
    nominal = best.covariance * max(1.0, SIGMA_PX / best.levels[0], SIGMA_MM / best.levels[1]) ** 2
    _refuse_weak(rows, best, nominal[:tangent, :tangent])
    more = sum((3, 4, 3)[len(one) - 1] for one in rows.spanning_mm) - 6
    excess = (best.squares - apart.freedom) / more if more > 0 else 1.0
    seen = [_place(rows, best, k) for k in range(len(rows.spanning_mm))]
    together = replace(
        apart,
        marker_from_source=best.transform,
        covariance=best.covariance[:tangent, :tangent],
        nominal_covariance=nominal[:tangent, :tangent],
        places=tuple(seen),
        sigma_px=best.levels[0],
        sigma_mm=best.levels[1],
        freedom=best.freedom,
        residuals_mm=best.residuals_mm,
        inlier=best.inlier,
        alternatives=(),
    )
    return together, best, excess


def refuse_free_phantom(source: str, spanning_mm: Sequence[Array]) -> None:
    """Refuse a phantom that may move without any of its targets showing it.

    Raises:
        DegenerateGeometryError: along what.
    """
    normals = np.concatenate([np.tile(normals_of_span(one), (len(one), 1)) for one in spanning_mm])
    places = np.concatenate([np.repeat(one, len(normals_of_span(one)), axis=0) for one in spanning_mm])
    arms = places - places.mean(axis=0)
    arms = arms / max(float(np.linalg.norm(arms, axis=1).max()), 1e-9)
    _, sizes, vt = np.linalg.svd(np.hstack([np.cross(arms, normals), normals]), full_matrices=True)
    if np.sum(sizes > FREE * sizes[0]) == 6:
        return
    turn, shift = vt[-1, :3], vt[-1, 3:]
    about = np.linalg.norm(turn) > FREE
    axis = turn if about else shift
    text = ", ".join(f"{x:.2f}" for x in np.round(axis / np.linalg.norm(axis), 2) + 0.0)
    raise DegenerateGeometryError(
        f"{source}: the phantom's targets leave it free to {'turn about' if about else 'slide along'} ({text}) of its "
        "frame, so its place has no answer; scan targets that are not parallel, or say where it is",
        "phantom-free",
    )


def _refuse_weak(rows: GroupRows, fit: GroupFit, nominal: Array) -> None:
    low, high = rows.points.min(axis=0), rows.points.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)
    worst = float(radius_95(point_covariance(fit.transform, nominal, corners)).max())
    if not worst < MOST_ERROR_MM:
        refuse(TOO_LITTLE, worst)


def _starts(rows: GroupRows, places: Sequence[Place]) -> Iterator[Array]:
    """The body from the phantom, by the directions that targets have and were found with, in each choice of signs."""
    known, free = _vectors(rows, places)
    chosen: list[int] = []
    for k, (direction, _) in enumerate(free):
        if len(chosen) < MOST_SIGNS and all(
            np.linalg.norm(np.cross(direction, free[m][0])) > LEAST_SINE for m in chosen
        ):
            chosen.append(k)
    for signs in product((1.0, -1.0), repeat=len(chosen)):
        pairs = known + [(free[k][0], s * free[k][1]) for k, s in zip(chosen, signs, strict=True)]
        moment = sum((np.outer(there, here) for here, there in pairs), np.zeros((3, 3)))
        u, sizes, vt = np.linalg.svd(moment)
        if sizes[1] < LEAST_SINE**2:
            return
        place = np.eye(4)
        place[:3, :3] = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
        place[:3, 3] = _shift(rows, places, place[:3, :3])
        yield place


def _misfit(rows: GroupRows, places: Sequence[Place], place: Array) -> float:
    """How far targets that were found are from where a phantom has them, mm^2, at the middle of each and beside it."""
    off = 0.0
    for spanning, found in zip(rows.spanning_mm, places, strict=True):
        held = normals_of_span(spanning) @ place[:3, :3].T
        there = spanning[0] @ place[:3, :3].T + place[:3, 3]
        off += float(np.sum((held @ (found.middle_mm - there)) ** 2))
        if found.direction is not None:
            along = found.direction if len(spanning) == 2 else np.cross(found.direction, held[0])
            off += float(np.sum((held @ along * REACH_MM) ** 2))
    return off


def _vectors(
    rows: GroupRows, places: Sequence[Place]
) -> tuple[list[tuple[Array, Array]], list[tuple[Array, Array]]]:
    """Unit vectors of the phantom with what they were found as; those whose sign is free apart."""
    known, free = [], []
    points = [k for k, one in enumerate(rows.spanning_mm) if len(one) == 1]
    for k, m in pairwise(points):
        step = rows.spanning_mm[m][0] - rows.spanning_mm[k][0]
        found = places[m].middle_mm - places[k].middle_mm
        known.append((step / np.linalg.norm(step), found / max(float(np.linalg.norm(found)), 1e-9)))
    for spanning, place in zip(rows.spanning_mm, places, strict=True):
        if place.direction is not None:
            sides = spanning[1:] - spanning[0]
            told = sides[0] if len(sides) == 1 else np.cross(sides[0], sides[1])
            free.append((told / np.linalg.norm(told), place.direction))
    return known, free


def _shift(rows: GroupRows, places: Sequence[Place], turn: Array) -> Array:
    held = [normals_of_span(one) for one in rows.spanning_mm]
    left = np.concatenate([n @ turn.T for n in held])
    right = np.concatenate(
        [
            n @ (turn.T @ place.middle_mm - one[0])
            for n, place, one in zip(held, places, rows.spanning_mm, strict=True)
        ]
    )
    return np.asarray(np.linalg.lstsq(left, right, rcond=1e-9)[0])


def _place(rows: GroupRows, fit: GroupFit, k: int) -> Place:
    """Where a target is, next to what was seen of it, by where the phantom is."""
    spanning = rows.spanning_mm[k] @ fit.body_from_phantom[:3, :3].T + fit.body_from_phantom[:3, 3]
    normals = normals_of_span(spanning)
    mine = (rows.target == k) & fit.inlier
    marker = fit.transform @ rows.points[mine]
    seen = np.einsum("nji,nj->ni", rows.poses[mine, :3, :3], marker - rows.poses[mine, :3, 3])
    middle = seen.mean(axis=0) if mine.any() else spanning[0]
    middle = middle - normals.T @ (normals @ (middle - spanning[0]))
    along = np.linalg.svd(normals)[2][len(normals) :]
    axes = np.vstack([normals, along]).T
    motion = Similarity.from_matrix(fit.body_from_phantom)
    arm = middle - motion.translation
    shifts = np.hstack([np.cross(arm, normals), normals])
    turns = [np.hstack([np.cross(a, normals), np.zeros_like(normals)]) for a in along]
    jacobian = np.vstack([shifts, *turns]) if len(normals) < 3 else shifts
    covariance = jacobian @ fit.covariance[-6:, -6:] @ jacobian.T
    direction = {1: None, 2: axes[:, 2], 3: axes[:, 0]}[len(spanning)]
    return Place(("point", "line", "plane")[len(spanning) - 1], middle, direction, axes, covariance)
