"""Rows whose targets are of one phantom of known shape: its place is found, and theirs follow from it."""

from __future__ import annotations

import numpy as np

from sonocal.calibration.found_phantom import FoundPhantom, found_phantom
from sonocal.calibration.placed_rows import PlacedRows, frames_of, full_poses
from sonocal.errors import UnsupportedError
from sonocal.observations import Observations
from sonocal.registration.group_places import placed_together, refuse_free_phantom
from sonocal.registration.rigid_group import GroupRows
from sonocal.registration.unplaced import Placed
from sonocal.targets import Phantom, Unplaced

__all__ = ["phantom_among", "with_phantom"]


def phantom_among(rows: Observations, seen: PlacedRows, *, timed: bool) -> Phantom | None:
    """The phantom that all rows are of; None where they are of none.

    Raises:
        UnsupportedError: other targets, or a second phantom, or a lag is asked for with it.
        DegenerateGeometryError: the phantom may move without its targets showing it.
    """
    given = [one for one, _ in seen.given.values()]
    phantoms = {one.phantom for one in given if isinstance(one, Unplaced) and one.phantom is not None}
    if not phantoms:
        return None
    others = [one.name for one in given if not (isinstance(one, Unplaced) and one.phantom is not None)]
    what = {
        "two phantoms": len(phantoms) > 1,
        "targets beside it": bool(others) or len(seen.targets) > len(given),
        "a latency to be estimated": timed,
    }
    if which := next((name for name, is_so in what.items() if is_so), None):
        raise UnsupportedError(
            f"{rows.source}: asks for the place of a phantom with {which}, which are not found together; leave that out"
        )
    refuse_free_phantom(rows.source, [one.in_phantom_mm for one in given])  # type: ignore[misc,union-attr]
    return next(iter(phantoms))


def with_phantom(
    rows: Observations, seen: PlacedRows, apart: Placed, phantom: Phantom, threshold_mm: float
) -> tuple[Placed, FoundPhantom]:
    """The answer with all targets as one phantom, and that phantom's place.

    Args:
        rows: of its targets.
        seen: them, with their poses.
        apart: the answer with each target placed by itself.
        phantom: whose they are.
        threshold_mm: rows within this distance agree.
    """
    from scipy.special import fdtrc

    shapes = {number: one.in_phantom_mm for one, number in seen.given.values() if isinstance(one, Unplaced)}
    points = rows.points_px
    group = GroupRows(
        points=np.column_stack([points, np.zeros((len(points), 3 - points.shape[1]))]),
        poses=full_poses(seen.poses),
        target=seen.target,
        frame=frames_of(rows),
        spanning_mm=tuple(shapes[k] for k in sorted(shapes)),  # type: ignore[misc]
        tracked=phantom.fixed_to.lower() != "tracker",
        dimension=points.shape[1],
    )
    together, fit, excess = placed_together(group, apart, threshold_mm)
    more = max(sum((3, 4, 3)[len(one) - 1] for one in group.spanning_mm) - 6, 1)
    chance = float(fdtrc(more, max(apart.freedom, 1), max(excess, 0.0)))
    middle = np.mean([place.middle_mm for place in together.places], axis=0)
    return together, found_phantom(
        phantom, fit.body_from_phantom, fit.covariance[-6:, -6:], middle, (excess, chance)
    )
