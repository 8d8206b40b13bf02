"""Errors of places in the image that no similarity takes up: tests of single forms, each with all its power."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.mapped import MappedRows
from sonocal.registration.noise import stretch_length
from sonocal.registration.noise_in_columns import ABOVE_NOISE, noise_beyond
from sonocal.registration.uncertainty import point_jacobian
from sonocal.registration.whitened import across_lines, whitened

__all__ = ["Distortion", "likeliest_distortion", "repeats", "side_by_side", "taken_up"]

FormsAt = Callable[[Array], dict[str, Array]]

# Of a form, what the transform does not take up: less is rounding, and the form is not seen.
LEAST_SEEN = 1e-4


@dataclass(frozen=True, eq=False)
class Distortion:
    """A form of the image's error, fitted to the rows beside the transform.

    Attributes:
        form: its name.
        size: how many times the form; deviation: of that.
        p_value: of none.
        moved: (k,), the tangent from the fit without it to the fit with it.
        pulled: (k,), what of one of the form the transform takes up.
        freedom: independent residuals to spare that the deviation rests on.
    """

    form: str
    size: float
    deviation: float
    p_value: float
    moved: Array
    pulled: Array
    freedom: float


def likeliest_distortion(
    mapped: MappedRows,
    chosen: NDArray[np.bool_],
    forms: dict[str, Array],
    *,
    levels: tuple[float, float],
    parameters: int,
    groups: list[NDArray[np.int64]],
    forms_at: FormsAt | None = None,
) -> Distortion | None:
    """The form of distortion that the rows speak for most surely.

        r = J d + a A f + e        seen at x + a f(x), what lies at x

    One form has one number: a test of it knows what to look for, and sees what a test of all smooth fields does not.
    Errors that neighbouring frames or the rows of a group share make it less sure.

    Args:
        mapped: rows under the transform.
        chosen: (N,): those to look at.
        forms: by name: (N, 3), px, how far it moves each row's point at size one.
        levels: noise of a point, px, and of a segment's end, mm; both 0 where rows weigh alike.
        parameters: k, of the transform's tangent.
        groups: (N,) each: of rows that may share an error.
        forms_at: the forms at places (M, 3), px, of the chosen rows: what their noise has in common with the residuals
            is taken off, and forms that are mostly noise are not looked for. None: forms are exact.

    Returns:
        The form with the least p-value; None where no row is to spare, or no form is seen.
    """
    from scipy.special import stdtr

    rows = side_by_side(mapped, chosen)
    white = whitened(mapped, rows, _columns(mapped, rows, forms, parameters), levels).reshape(
        2 * len(rows), -1
    )
    jacobian, columns, residuals = white[:, :parameters], white[:, parameters:-1], white[:, -1]
    freedom = len(residuals) - parameters - 1
    basis, taken = taken_up(jacobian, columns)
    beyond, left = columns - jacobian @ taken, residuals - basis @ (basis.T @ residuals)
    squares, pull = np.sum(beyond**2, axis=0), beyond.T @ left
    seen = squares > LEAST_SEEN**2 * np.sum(columns**2, axis=0)
    if forms_at is not None:
        columns_at = partial(_moved, mapped, forms_at, parameters)
        own, common = noise_beyond(mapped, rows, columns_at, taken, levels)
        seen &= squares > ABOVE_NOISE**2 * own.diagonal()
        pull -= common
    if freedom < 1 or not seen.any():
        return None
    sizes = np.where(seen, pull / np.where(seen, squares, 1.0), 0.0)
    rest = np.maximum(left @ left - sizes**2 * squares, np.finfo(float).tiny)
    best = int(np.argmax(sizes**2 * squares / rest))
    unexplained = left - beyond @ np.linalg.lstsq(beyond, left, rcond=None)[0]
    alike = repeats(mapped, rows, unexplained.reshape(-1, 2), groups)
    deviation = float(np.sqrt(alike * rest[best] / freedom / squares[best]))
    return Distortion(
        form=list(forms)[best],
        size=float(sizes[best]),
        deviation=deviation,
        p_value=float(2.0 * stdtr(max(freedom / alike, 1.0), -abs(sizes[best]) / deviation)),
        moved=-np.linalg.lstsq(jacobian, residuals - sizes[best] * columns[:, best], rcond=None)[0],
        pulled=np.asarray(np.linalg.lstsq(jacobian, columns[:, best], rcond=None)[0]),
        freedom=max(freedom / alike, 1.0),
    )


def side_by_side(mapped: MappedRows, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The chosen rows, those of one sighting together."""
    rows, sightings = np.flatnonzero(chosen), mapped.table.sightings
    return rows if sightings is None else rows[np.argsort(sightings[rows], kind="stable")]


def taken_up(known: Array, columns: Array) -> tuple[Array, Array]:
    """An orthonormal basis (m, k) of known columns (m, k), and how much of these others (m, C) take up: (k, C)."""
    size = np.linalg.norm(known, axis=0)
    basis, triangle = np.linalg.qr(known / size)
    return basis, np.linalg.lstsq(triangle, basis.T @ columns, rcond=None)[0] / size[:, None]


def _columns(mapped: MappedRows, rows: NDArray[np.int64], forms: dict[str, Array], parameters: int) -> Array:
    """(M, 3, k + F + 1), mm: derivatives by the tangent and by the forms, and the residuals."""
    chosen = {name: form[rows] for name, form in forms.items()}
    moved = _moved(mapped, lambda _: chosen, parameters, mapped.table.points[rows])
    return np.concatenate([moved, mapped.residuals[rows][:, :, None]], axis=2)


def _moved(mapped: MappedRows, forms_at: FormsAt, parameters: int, points: Array) -> Array:
    """(M, 3, k + F), mm: derivatives by the tangent and by the forms, at points (M, 3), px."""
    axes = mapped.transform.rotation * mapped.transform.scales
    forms = np.stack([form @ axes.T for form in forms_at(points).values()], axis=2)
    return np.concatenate([point_jacobian(mapped.transform, points, parameters), forms], axis=2)


def repeats(
    mapped: MappedRows, rows: NDArray[np.int64], left: Array, groups: list[NDArray[np.int64]]
) -> float:
    """How many rows carry as much as one independent row: of neighbouring frames, and of the rows of a group.

    Args:
        mapped: rows under the transform.
        rows: (M,), indices of those looked at.
        left: (M, 2), residuals across the lines.
        groups: (N,) each.
    """
    vectors = np.einsum("nij,ni->nj", across_lines(mapped.directions[rows]), left)
    alike = 1.0
    assert mapped.table.frame is not None
    order = np.argsort(mapped.table.frame[rows], kind="stable")
    alike = max(alike, float(stretch_length(vectors[order], mapped.table.frame[rows][order])))
    for group in groups:
        codes = np.unique(group[rows], return_inverse=True)[1].reshape(-1)
        if 1 < codes.max(initial=0) + 1 < len(rows):
            sums = np.stack([np.bincount(codes, one) for one in vectors.T])
            alike = max(alike, float(np.sum(sums**2) / max(np.sum(vectors**2), np.finfo(float).tiny)))
    return alike
