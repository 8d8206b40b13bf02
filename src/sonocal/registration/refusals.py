"""What `register` refuses: too few correspondences, those that leave a motion free, and agreement by chance."""

from __future__ import annotations

import numpy as np

from sonocal import _core
from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.geometry import Array, Similarity
from sonocal.registration.constraints import Rows, rank, refuse_degenerate_rows
from sonocal.registration.rows import to_core

__all__ = ["PARAMETERS", "refuse_chance", "refuse_few", "refuse_free", "refuse_free_about"]

# Of a similarity: three of rotation, three of translation, one of scale.
PARAMETERS = 7
# Of a size or a scale that is divided by.
LEAST = 1e-300
# Where the search for any solution begins: no turn, and two radians either way about each axis; quaternions (w, axis).
TURNS = np.vstack(
    [np.eye(4)[0], *(np.cos(1.0) * np.eye(4)[0] + way * np.sin(1.0) * np.eye(4)[1:] for way in (1, -1))]
)


def refuse_chance(
    table: _core.Table, similarity: Similarity, residuals_mm: Array, threshold_mm: float
) -> None:
    """Raise if as many correspondences would agree had sources and targets nothing to do with each other."""
    found = _core.agreement(table, to_core(similarity), residuals_mm, threshold_mm)
    if not found.by_chance_alone:
        return
    count = len(residuals_mm)
    if threshold_mm == np.inf:
        rms = float(np.sqrt(np.mean(residuals_mm**2)))
        raise NoConsensusError(
            f"the best similarity leaves the {count} correspondences {rms:.3g} mm (rms) from their targets, no nearer "
            "than chance would; check that they are matched and in the units meant, or leave out those that are not "
            "with robust=True",
            best_count=found.agreeing,
        )
    raise NoConsensusError(
        f"the best similarity brings {found.agreeing} of {count} correspondences within {threshold_mm:.3g} mm of "
        f"their targets, no more than chance would (up to {found.by_chance} of {count}); check that they are "
        "matched and in the units meant, or give a threshold_mm nearer to the noise",
        best_count=found.agreeing,
    )


def refuse_few(constraints: Rows) -> None:
    """Raise if there are too few rows to determine a similarity, with the motion that they leave free."""
    if not len(constraints):
        raise InputError("there is no correspondence to register; give points, lines or planes")
    if len(constraints) < PARAMETERS:
        refuse_free(constraints)


def refuse_free(constraints: Rows) -> None:
    """Raise if the rows leave a motion free: whatever the solution, or about one of their solutions."""
    refuse_degenerate_rows(constraints.points, constraints.planes)
    refuse_free_about(constraints, _any_solution(constraints))


def refuse_free_about(constraints: Rows, similarity: Similarity, *, scale_known: bool = False) -> None:
    """Raise if the rows leave a motion free about a similarity."""
    free, wanted = rank(constraints, similarity, scale_known=scale_known), PARAMETERS - scale_known
    if free.rank < wanted:
        raise DegenerateGeometryError(
            f"the correspondences determine {free.rank} of {wanted} motions; free: "
            f"{'; '.join(free.motions)}; add one that holds it",
            code="rank-deficient",
        )


def _any_solution(constraints: Rows) -> Similarity:
    """One of the similarities that rows which determine none allow: least squares from several turns.

    A quaternion's length is the square root of the scale: residuals are then polynomials, with simple derivatives.
    """
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    points, normals, offsets = constraints.points, constraints.planes[:, :3], constraints.planes[:, 3]
    centre = points.mean(axis=0)
    size = max(float(np.abs(points - centre).max()), LEAST)
    reach = max(float(np.abs(offsets).max()), LEAST)
    points, offsets = (points - centre) / size, offsets / reach
    along = np.einsum("ij,ij->i", normals, points)
    across = np.cross(points, normals)

    def residuals(v: Array) -> Array:
        w, axis, shift = v[0], v[1:4], v[4:]
        turned = 2.0 * (points @ axis * (normals @ axis) + w * (across @ axis))
        return np.asarray((w * w - axis @ axis) * along + turned + normals @ shift + offsets)

    def derivatives(v: Array) -> Array:
        w, axis = v[0], v[1:4]
        of_w = 2.0 * (w * along + across @ axis)
        of_axis = 2.0 * (
            (points @ axis)[:, None] * normals
            + (normals @ axis)[:, None] * points
            + w * across
            - np.outer(along, axis)
        )
        return np.column_stack([of_w, of_axis, normals])

    fits = [least_squares(residuals, np.r_[turn, np.zeros(3)], derivatives) for turn in TURNS]
    best = min(fits, key=lambda fit: fit.cost).x
    length = float(np.linalg.norm(best[:4]))
    scale = max(length**2, LEAST) * reach / size
    rotation = Rotation.from_quat(best[[1, 2, 3, 0]]).as_matrix() if length > LEAST else np.eye(3)
    return Similarity(rotation, reach * best[4:] - scale * rotation @ centre, scale)
