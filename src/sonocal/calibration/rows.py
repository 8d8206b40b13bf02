"""A table of sightings as registration takes it: checked, split, in arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError, UnsupportedError, require
from sonocal.geometry import Array, AxisScaled, homogeneous_points
from sonocal.observations import Observations, group_codes
from sonocal.observations.image_size import size_in_words
from sonocal.observations.poses import unplaced_rows
from sonocal.registration.noise import residual_vectors
from sonocal.registration.options import Model, Options
from sonocal.registration.robust import MINIMAL_ROWS
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = [
    "check_rows",
    "image_area",
    "known_image_size",
    "known_levels",
    "line_distances",
    "point_line_rows",
    "require_lines",
    "require_placed",
    "split_rows",
]


def split_rows(
    observations: Observations, fit_split: str | None, test_split: str | None
) -> tuple[Observations, Observations | None]:
    """The rows to fit and those held out, by their split.

    Raises:
        InputError: there is no table, or a split is none of its.
    """
    require("observations", observations, Observations)
    held_out = None if test_split is None else observations.select_split(test_split)
    if fit_split is not None:
        return observations.select_split(fit_split), held_out
    if held_out is not None:
        return observations.select(observations.split != test_split), held_out
    return observations, None


def point_line_rows(observations: Observations) -> PointLineRows:
    """The table as registration takes it.

    Raises:
        UnsupportedError: it holds points or planes.
    """
    require_lines(observations)
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


def require_lines(observations: Observations) -> None:
    """Refuse a table in which some targets are no lines, for what is said of lines alone.

    Raises:
        UnsupportedError: it has such a row.
    """
    if not observations.lines_only:
        require_placed(observations)
        row = int(np.argmax(observations.spans != 2))
        what = "a point" if observations.spans[row] == 1 else "a plane"
        raise UnsupportedError(
            f"{observations.where(row)}: is of {what}; sonocal calibrate takes any mix, and this lines alone: leave "
            "such rows out"
        )


def require_placed(observations: Observations) -> None:
    """Refuse rows whose target's place is not known.

    Raises:
        UnsupportedError: there is one.
    """
    asked = unplaced_rows(observations)
    if asked.any():
        row = int(np.argmax(asked))
        raise UnsupportedError(
            f"{observations.where(row)}: says nothing of where its target {str(observations.target[row])!r} is; "
            "sonocal calibrate finds it with the calibration, this needs to know it: give its spanning points"
        )


def check_rows(rows: Observations, model: Model) -> None:
    """Refuse too few rows, and 3D sightings that are no lines."""
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
    sightings, segments = rows.sightings, rows.segments_mm.reshape(-1, 6)
    order = np.arange(len(rows))
    if not (sightings[1:] >= sightings[:-1]).all():
        order = np.argsort(sightings, kind="stable")
        sightings, segments = sightings[order], segments[order]
    wrong = (sightings[1:] == sightings[:-1]) & (segments[1:] != segments[:-1]).any(axis=1)
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


def known_image_size(rows: Observations, told_px: tuple[int, ...] | None) -> tuple[int, ...] | None:
    """The size of the images: what an option says, or the table; None where neither does.

    Raises:
        InputError: it is of another dimension than the points, or the two are not the same.
    """
    if told_px is not None and len(told_px) != rows.dimension:
        raise InputError(
            f"image_size_px must be {rows.dimension} positive numbers for a {rows.dimension}D probe; got {told_px}"
        )
    stated = rows.image_size_px
    if told_px is not None and stated is not None and told_px != stated:
        raise InputError(
            f"{rows.source}: says that its images have {size_in_words(stated)} px and image_size_px says "
            f"{size_in_words(told_px)}; leave the option out, or correct the one that is wrong"
        )
    return told_px or stated


def image_area(
    rows: Observations, inlier: NDArray[np.bool_], told_px: tuple[int, ...] | None
) -> tuple[tuple[int, ...] | None, Array, Array]:
    """The images' size where it is known, the box (2, d), px, of the rows that agree, and the image's box.

    The image's box is that of the rows where the size is not known.

    Raises:
        InputError: as `known_image_size`.
    """
    size = known_image_size(rows, told_px)
    points = rows.points_px[inlier]
    seen = np.array([points.min(axis=0), points.max(axis=0)])
    return size, seen, seen if size is None else np.array([np.zeros(len(size)), np.asarray(size) - 1.0])


def known_levels(table: PointLineRows | TargetRows, options: Options) -> dict[str, bool]:
    """Which noise levels are given, and not to be found in the residuals; as `estimate_noise` takes it."""
    return {
        "known_px": table.level_px(options.sigma_px) > 0,
        "known_mm": table.level_mm(options.sigma_mm) > 0,
    }


def line_distances(probe_from_image: AxisScaled, rows: Observations) -> Array:
    """(N,), mm: of each mapped point to its line. Raises as `point_line_rows`."""
    require_lines(rows)
    points = homogeneous_points(rows.points_px)
    return np.asarray(np.linalg.norm(residual_vectors(probe_from_image, points, rows.segments_mm), axis=1))
