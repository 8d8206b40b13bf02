"""How a solver is called: batches into compiled code, and in words what does not fit or leaves a motion free."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.registration.constraints import planes_of_lines, refuse_degenerate_rows

__all__ = [
    "FLAT",
    "LINES",
    "PAIRS",
    "PLANE",
    "ROWS",
    "SPACE",
    "Solutions",
    "array",
    "call",
    "known_scale",
    "rows_as_given",
    "rows_of_lines",
    "rows_of_places",
    "rows_of_plane",
    "rows_of_space",
    "solve",
    "with_zero",
]

# How messages name what a solver takes.
PLANE = ("points_px (..., 4, 2)", "segments_mm (..., 4, 2, 3)")
LINES = ("image_segments (..., 2, 2, 3)", "needle_segments (..., 2, 2, 3)")
ROWS = ("points (..., N, 3)", "planes (..., N, 4), N >= 7 (6 where the scale is known)")
FLAT = ("points_px (..., N, 2)", "planes (..., N, 4), N >= 7")
PAIRS = ("points (..., 3, 3)", "places_mm (..., 3, 3)")
SPACE = ("points (..., 4, 3)", "segments_mm (..., 4, 2, 3)")


@dataclass(eq=False, slots=True)  # not frozen: that costs half a microsecond a call
class Solutions:
    """The similarities that solve each problem of a batch.

    Attributes:
        matrices: (..., K, 4, 4), mm from px, `count` of them first and NaN after; s > 0, det R = +1.
        count: (...), or a number where one problem was given: how many there are; 0 where the problem is
            degenerate or noise leaves no real one.
    """

    matrices: Array
    count: NDArray[np.int64] | int


def solve(
    core: Callable[..., Any],
    arrays: tuple[ArrayLike, ArrayLike],
    names: tuple[str, str],
    rows: Callable[[Array, Array], tuple[Array, Array]],
    *options: float,
    scale_known: bool = False,
) -> Solutions:
    """What a solver of the core finds; of one problem without any, the refusal that names its free motion."""
    # The fast path is one try: shapes are checked by the compiled side, sentences are made when it objects.
    try:
        matrices, count = core(arrays[0], arrays[1], *options)
    except (TypeError, ValueError):
        arrays = (array(arrays[0]), array(arrays[1]))
        matrices, count = call(core, arrays, names, *options)
    if count.__class__ is int and count == 0:
        refuse_degenerate_rows(*rows(array(arrays[0]), array(arrays[1])), scale_known=scale_known)
    return Solutions(matrices, count)


def call(
    core: Callable[..., Any], arrays: tuple[Array, Array], names: tuple[str, str], *options: float
) -> Any:
    """What the core gives, or shapes and options that do not fit in a sentence."""
    try:
        return core(*arrays, *options)
    except ValueError as error:
        if not str(error).startswith("shapes "):  # the options', whose sentence says all
            raise InputError(str(error)) from None
        raise InputError(
            f"expected {names[0]} and {names[1]} with the same leading axes; "
            f"got {arrays[0].shape} and {arrays[1].shape}"
        ) from None


def rows_of_plane(points: Array, segments: Array) -> tuple[Array, Array]:
    """Points (4, 2) of an image and lines (4, 2, 3) as rows: points (8, 3) and planes (8, 4)."""
    return rows_of_space(with_zero(points), segments)


def rows_of_space(points: Array, segments: Array) -> tuple[Array, Array]:
    """Points (4, 3) and lines (4, 2, 3) as rows: points (8, 3) and planes (8, 4)."""
    return np.repeat(points, 2, axis=0), planes_of_lines(segments).reshape(8, 4)


def rows_of_lines(image: Array, needles: Array) -> tuple[Array, Array]:
    """Two lines by two points each and two needles (2, 2, 3) as rows: points (8, 3) and planes (8, 4)."""
    return rows_of_space(image.reshape(4, 3), np.repeat(needles, 2, axis=0))


def rows_of_places(points: Array, places: Array) -> tuple[Array, Array]:
    """Three points (3, 3) and their places as rows: points (9, 3) and planes (9, 4)."""
    normals = np.tile(np.eye(3), (3, 1))
    planes = np.column_stack([normals, -np.sum(normals * np.repeat(places, 3, axis=0), axis=1)])
    return np.repeat(points, 3, axis=0), planes


def rows_as_given(points: Array, planes: Array) -> tuple[Array, Array]:
    """Points (N, 3) and planes (N, 4), which are rows."""
    return points, planes


def known_scale(scale: float, steps: int = 1) -> float:
    """A scale that is known, as the core takes it; where it overdetermines a sample, `steps` fit it."""
    if not (scale > 0 and np.isfinite(scale)):
        raise InputError(f"a known scale is positive and finite, in mm per px; got {scale}")
    if steps < 1:
        raise InputError("a known scale overdetermines the problem; give steps=2 or more to fit it")
    return float(scale)


def array(values: ArrayLike) -> Array:
    """As the core takes it."""
    return np.ascontiguousarray(values, dtype=np.float64)


def with_zero(points_px: Array) -> Array:
    """Points (..., N, 2) of an image as (..., N, 3), in the plane w = 0."""
    if points_px.shape[-1:] != (2,):
        raise InputError(f"points_px must have shape (..., N, 2); got {points_px.shape}")
    return np.concatenate([points_px, np.zeros((*points_px.shape[:-1], 1))], axis=-1)
