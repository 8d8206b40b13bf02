"""A table of sightings as registration takes it: checked, split, in arrays."""

from __future__ import annotations

import numpy as np

from sonocal.errors import InputError, UnsupportedError
from sonocal.geometry import Array, AxisScaled, homogeneous_points
from sonocal.observations import Observations, group_codes
from sonocal.registration.noise import residual_vectors
from sonocal.registration.options import Model
from sonocal.registration.robust import MINIMAL_ROWS
from sonocal.registration.rows import PointLineRows

__all__ = ["check_rows", "image_area", "line_distances", "point_line_rows", "split_rows"]


def split_rows(
    observations: Observations, fit_split: str | None, test_split: str | None
) -> tuple[Observations, Observations | None]:
    """The rows to fit and those held out, by their split."""
    held_out = None if test_split is None else observations.select_split(test_split)
    if fit_split is not None:
        return observations.select_split(fit_split), held_out
    if held_out is not None:
        return observations.select(observations.split != test_split), held_out
    return observations, None


def point_line_rows(observations: Observations) -> PointLineRows:
    """The table as registration takes it."""
    sightings = observations.sightings.astype(np.int32) if observations.dimension == 3 else None
    return PointLineRows(
        points=np.ascontiguousarray(homogeneous_points(observations.points_px)),
        segments_mm=np.ascontiguousarray(observations.segments_mm),
        dimension=observations.dimension,
        sightings=sightings,
        frame=group_codes(observations.split, observations.frame).astype(np.int32),
        target=group_codes(observations.target).astype(np.int32),
        sigma_px=observations.sigma_px,
        sigma_mm=observations.sigma_mm,
    )


def check_rows(rows: Observations, model: Model) -> None:
    """Refuse too few rows, and 3D sightings that are no lines."""
    if rows.dimension == 3 and model == "anisotropic":
        raise UnsupportedError(
            "the anisotropic model is for 2D probes; calibrate a 3D probe with the similarity model"
        )
    needed = MINIMAL_ROWS + (model == "anisotropic")
    if len(rows) < needed:
        raise InputError(
            f"{rows.source}: has {len(rows)} rows to fit and the {model} model of a {rows.dimension}D probe needs "
            f"at least {needed}; scan more needle poses, ten or more for an answer to rely on"
        )
    if rows.dimension == 3:
        _check_sightings(rows)


def _check_sightings(rows: Observations) -> None:
    """A 3D sighting is one needle: two points or more on its image line, one segment."""
    sightings = rows.sightings
    order = np.argsort(sightings, kind="stable")
    segments = rows.segments_mm.reshape(-1, 6)[order]
    wrong = (sightings[order[1:]] == sightings[order[:-1]]) & (segments[1:] != segments[:-1]).any(axis=1)
    if wrong.any():
        first, second = np.sort(order[np.argmax(wrong) + np.arange(2)])
        raise InputError(
            f"{rows.where(second)}: has another segment than {rows.where(first).removeprefix(rows.source + ', ')} "
            f"of the same frame {rows.frame[second]} and target {str(rows.target[second])!r}; points of one needle in "
            "one image share its segment, other needles need another target"
        )
    if np.count_nonzero(np.bincount(sightings) >= 2) < 2:
        raise InputError(
            f"{rows.source}: fewer than two sightings have two points; a 3D probe sees a needle as a line, so give "
            "two or more rows with one frame and target, or leave out w_px for a 2D probe"
        )


def image_area(rows: Observations, image_size_px: tuple[int, ...] | None) -> Array:
    """(2, d), px: the least and the greatest corner of the image, or of the box that holds the points."""
    if image_size_px is None and not len(rows):
        return np.zeros((2, rows.dimension))  # `check_rows` says what is missing
    if image_size_px is None:
        return np.array([rows.points_px.min(axis=0), rows.points_px.max(axis=0)])
    if len(image_size_px) != rows.dimension:
        raise InputError(
            f"image_size_px must be {rows.dimension} positive numbers for a {rows.dimension}D probe; "
            f"got {image_size_px}"
        )
    return np.array([np.zeros(rows.dimension), np.asarray(image_size_px) - 1.0])


def line_distances(probe_from_image: AxisScaled, rows: Observations) -> Array:
    """(N,), mm: of each mapped point to its line."""
    points = homogeneous_points(rows.points_px)
    return np.asarray(np.linalg.norm(residual_vectors(probe_from_image, points, rows.segments_mm), axis=1))
