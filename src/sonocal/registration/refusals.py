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
    """One of the similarities that rows which determine none allow: least squares from several turns."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    points, normals, offsets = constraints.points, constraints.planes[:, :3], constraints.planes[:, 3]
    centre = points.mean(axis=0)
    size = max(float(np.abs(points - centre).max()), 1e-300)
    reach = max(float(np.abs(offsets).max()), 1e-300)

    def similarity(v: Array) -> Similarity:
        rotation = Rotation.from_rotvec(v[:3]).as_matrix()
        scale = float(np.exp(v[6])) * reach / size
        return Similarity(rotation, reach * v[3:6] - scale * rotation @ centre, scale)

    def residuals(v: Array) -> Array:
        return np.asarray((np.einsum("ij,ij->i", normals, similarity(v) @ points) + offsets) / reach)

    turns = [np.zeros(3), *(2.0 * np.eye(3)), *(-2.0 * np.eye(3))]
    fits = [least_squares(residuals, np.concatenate([turn, np.zeros(4)])) for turn in turns]
    return similarity(min(fits, key=lambda fit: fit.cost).x)
