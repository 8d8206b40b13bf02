"""Correspondences of points, lines and planes as point-plane rows.

Every correspondence holds some points of the source to some planes of the target, n . (A x) + d = 0; a
list of such rows is what all solvers take.

Source: paper section 5.1; Ramalingam and Taguchi 2010.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal import _core
from sonocal.errors import DegenerateGeometryError, InputError, require
from sonocal.geometry import Array, Similarity, real_array
from sonocal.geometry.shown import brief
from sonocal.registration.options import positive_number
from sonocal.registration.plane_samples import PlaneSamples, joined_samples, normals_of
from sonocal.registration.rows import PointLineRows
from sonocal.registration.spanned import SpannedRows, joined_spanned, spanned

__all__ = [
    "FreeMotion",
    "Rows",
    "line_line",
    "line_plane",
    "plane_plane",
    "planes_of_lines",
    "point_line",
    "point_plane",
    "point_point",
    "rank",
    "refuse_degenerate_rows",
    "rows",
]

# Of coordinates, in whatever unit: their products are numbers still.
LARGEST = 1e30
# Singular values below this part of the largest, in coordinates of order one, count as zero.
RANK_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Rows:
    """Points to bring into planes.

    Attributes:
        points: (N, 3), source coordinates (px).
        planes: (N, 4), target coordinates (mm): (n, d), |n| = 1, n . x + d = 0.
        first: (C + 1,): correspondence c has the rows ``first[c]`` up to ``first[c + 1]``.
        lines: the same as points on lines, where all are points of a plane w = 0 on lines, or all are lines
            on lines: what the fastest solvers take.
        samples: planes of the source among them, and which rows are theirs.
        spanned: the same against what points span, where every target is known by such points.
    """

    points: Array
    planes: Array
    first: NDArray[np.int32]
    lines: PointLineRows | None = None
    samples: PlaneSamples | None = None
    spanned: SpannedRows | None = None

    __repr__ = brief

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def core(self) -> _core.Table:
        """The rows as the core keeps them, checked once."""
        refuse_not_finite(self.points, self.planes)
        try:
            return _core.Table.of_planes(self.points, self.planes, self.first)
        except ValueError as error:
            raise InputError(f"the rows cannot be registered: {error}") from None

    def select(self, chosen: NDArray[np.bool_]) -> Rows:
        """The rows of the correspondences (C,) that are chosen, as points and planes."""
        sizes = np.diff(self.first)
        row = np.repeat(chosen, sizes)
        first = np.concatenate([[0], np.cumsum(sizes[chosen])]).astype(np.int32)
        spanned = None if self.spanned is None else self.spanned.select(chosen)
        return Rows(self.points[row], self.planes[row], first, spanned=spanned)


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """How many of the seven motions rows determine, and which they leave.

    Attributes:
        rank: 0 to 7; 7 is a similarity, up to finitely many.
        motions: one sentence part a free motion, such as "translation along (0, 0, 1)".
    """

    rank: int
    motions: tuple[str, ...]

    __repr__ = brief


def point_plane(points: ArrayLike, planes: ArrayLike) -> Rows:
    """Points (N, 3) in planes (N, 4), or through three points each (N, 3, 3): one row each."""
    x, target = _last(points, 3, "points"), _planes(planes)
    return _rows(x, target.planes, 1, spanned=target.spanned(x))


def point_line(points: ArrayLike, segments: ArrayLike) -> Rows:
    """Points (N, 3) on lines through segments (N, 2, 3): two rows each, of perpendicular planes."""
    x, ends = _last(points, 3, "points"), _segments(segments)
    lines = PointLineRows(x, ends, dimension=2) if len(x) == len(ends) and not x[:, 2].any() else None
    there = spanned(x, ends) if len(x) == len(ends) else None
    return _rows(np.repeat(x, 2, axis=0), planes_of_lines(ends).reshape(-1, 4), 2, lines, there)


def point_point(source: ArrayLike, target: ArrayLike) -> Rows:
    """Points (N, 3) at points (N, 3): three rows each, of planes parallel to the axes."""
    x, y = _last(source, 3, "points"), _last(target, 3, "target points")
    normals = np.broadcast_to(np.eye(3), (len(y), 3, 3))
    planes = np.concatenate([normals, -y[:, :, None]], axis=-1)
    there = spanned(x, y[:, None]) if len(x) == len(y) else None
    return _rows(np.repeat(x, 3, axis=0), planes.reshape(-1, 4), 3, spanned=there)


def line_line(source_segments: ArrayLike, target_segments: ArrayLike) -> Rows:
    """Lines (N, 2, 3) on lines (N, 2, 3): both source points on the target line, four rows each (eq. 6-9)."""
    ends, needles = _segments(source_segments), np.repeat(_segments(target_segments), 2, axis=0)
    points = ends.reshape(-1, 3)
    sightings = np.repeat(np.arange(len(ends), dtype=np.int32), 2)
    lines = PointLineRows(points, needles, dimension=3, sightings=sightings)
    fits = len(points) == len(needles)
    return _rows(
        np.repeat(points, 2, axis=0),
        planes_of_lines(needles).reshape(-1, 4),
        4,
        lines if fits else None,
        spanned(ends, needles[::2]) if fits else None,
    )


def line_plane(segments: ArrayLike, planes: ArrayLike) -> Rows:
    """Lines (N, 2, 3) in planes (N, 4), or through three points each (N, 3, 3): two rows each."""
    ends, target = _segments(segments), _planes(planes)
    return _rows(ends.reshape(-1, 3), np.repeat(target.planes, 2, axis=0), 2, spanned=target.spanned(ends))


def plane_plane(source_planes: ArrayLike, target_planes: ArrayLike, size: float | None = None) -> Rows:
    """Planes (N, 4) on planes (N, 4): three points of the source plane, three rows each.

    Of planes of the source as numbers (N, 4) the points lie about the place of the plane that is nearest to the centre
    of all sources, so that the answer moves with the source whatever its origin and axes are; `rows` finds that
    centre again. Where planes were measured by points, give these: what their noise makes of the answer is then known.

    Args:
        source_planes: (N, 4), or through three points each (N, 3, 3).
        target_planes: likewise.
        size: how far the three points lie from their middle, px, which weighs the directions; None: as far as the
            sources lie from their centre (root mean square).
    """
    size = None if size is None else positive_number("size", size)
    through, on = _planes(source_planes), _planes(target_planes)
    source, target = through.planes, np.repeat(on.planes, 3, axis=0)
    if through.points is not None:
        return _rows(through.points.reshape(-1, 3), target, 3, spanned=on.spanned(through.points))
    samples = PlaneSamples(
        source, np.full(len(source), np.nan if size is None else size), 3 * np.arange(len(source))
    )
    return replace(_rows(samples.placed(np.zeros((3 * len(source), 3))), target, 3), samples=samples)


def rows_of_spanned(sightings: SpannedRows) -> Rows:
    """Sightings as rows: a point of each in as many planes as meet in its target.

    Source: paper section 5.1.
    """
    count, sizes = len(sightings), np.diff(sightings.first)
    planes = np.zeros((count, 3, 4))
    for spans in (1, 2, 3):
        chosen = sightings.spans == spans
        planes[chosen, : 4 - spans] = _planes_through(sightings.spanning[chosen, :spans])
    each = (4 - sightings.spans)[np.repeat(np.arange(count), sizes)]
    point = np.repeat(np.arange(len(sightings.points)), each)
    which = np.arange(len(point)) - np.repeat(np.cumsum(each) - each, each)
    of_point = np.repeat(np.arange(count), sizes)[point]
    first = np.concatenate([[0], np.cumsum(sizes * (4 - sightings.spans))]).astype(np.int32)
    return Rows(
        np.ascontiguousarray(sightings.points[point]),
        np.ascontiguousarray(planes[of_point, which]),
        first,
        spanned=sightings,
    )


def _planes_through(points: Array) -> Array:
    """(C, 4 - K, 4): planes that meet in what K points (C, K, 3) span."""
    if points.shape[1] == 1:
        normals = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    elif points.shape[1] == 2:
        return planes_of_lines(points)
    else:
        across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        normals = (across / np.linalg.norm(across, axis=1, keepdims=True))[:, None]
    return np.concatenate([normals, -(normals @ points[:, 0, :, None])], axis=-1)


def rows(*parts: Rows) -> Rows:
    """All rows of several kinds of correspondence.

    Raises:
        InputError: there is none.
    """
    if not parts:
        raise InputError("there is no correspondence to put together; give rows of points, lines or planes")
    for part in parts:
        require("parts", part, Rows)
    if len(parts) == 1:
        return parts[0]
    starts = np.cumsum([0, *(len(p) for p in parts)])
    first = [p.first[:-1] + start for p, start in zip(parts, starts, strict=False)]
    points = np.concatenate([p.points for p in parts])
    samples = joined_samples([p.samples for p in parts], starts[:-1])
    return Rows(
        points if samples is None else samples.placed(points),
        np.concatenate([p.planes for p in parts]),
        np.concatenate([*first, starts[-1:]]).astype(np.int32),
        _together([p.lines for p in parts]),
        samples,
        joined_spanned([p.spanned for p in parts]),
    )


def _together(parts: list[PointLineRows | None]) -> PointLineRows | None:
    lines = [p for p in parts if p is not None]
    if len(lines) < len(parts) or len({p.dimension for p in lines}) > 1:
        return None
    starts = np.cumsum([0, *(len(p) // 2 for p in lines)])
    sightings = [
        p.sightings + start for p, start in zip(lines, starts, strict=False) if p.sightings is not None
    ]
    return PointLineRows(
        np.concatenate([p.points for p in lines]),
        np.concatenate([p.segments_mm for p in lines]),
        lines[0].dimension,
        np.concatenate(sightings).astype(np.int32) if sightings else None,
    )


def planes_of_lines(segments: ArrayLike) -> Array:
    """Two perpendicular planes (..., 2, 4) that meet in the line of each segment (..., 2, 3).

    They need no origin, so a line through it is no special case; the paper's own choice (section 9) is.
    """
    ends = _any_segments(segments)
    along = ends[..., 1, :] - ends[..., 0, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = normals_of(along / np.linalg.norm(along, axis=-1, keepdims=True))
    offsets = -np.einsum("...ij,...j->...i", normals, ends[..., 0, :])
    return np.concatenate([normals, offsets[..., None]], axis=-1)


def rank(constraints: Rows, similarity: Similarity | None = None, *, scale_known: bool = False) -> FreeMotion:
    """How many motions the rows determine near a solution, and which stay free.

    Args:
        constraints: the rows.
        similarity: a solution, about which the rows are linearised. Without one only motions are found
            that are free whatever the solution: translation, growth about a point, turns about an axis.
        scale_known: growth is none of the motions; for linearised rows.

    Returns:
        The rank and the free motions' descriptions.
    """
    x, n, d = constraints.points, constraints.planes[:, :3], constraints.planes[:, 3]
    if similarity is None:
        return _rank_of_parts(x, n, d)
    arms = similarity.scale * (x - x.mean(axis=0)) @ similarity.rotation.T
    arms = arms / max(np.linalg.norm(arms, axis=1).max(initial=0.0), 1e-300)
    jacobian = np.column_stack([np.cross(arms, n), n, np.einsum("ij,ij->i", arms, n)])
    motions = 6 if scale_known else 7
    _, values, right = np.linalg.svd(jacobian[:, :motions], full_matrices=True)
    values = np.pad(values, (0, motions - len(values)))[:motions]
    free = right[values <= RANK_TOLERANCE * values[0]]
    return FreeMotion(motions - len(free), tuple(_describe(np.pad(v, (0, 7 - motions))) for v in free))


def refuse_not_finite(points: Array, planes: Array) -> None:
    """Raise if there is no number where there must be one.

    Raises:
        InputError: a value is not finite.
    """
    if not np.all(np.isfinite(points)):
        raise InputError("the points must be finite; leave out those that were not seen")
    if not np.all(np.isfinite(planes)):
        raise InputError(
            "a line or plane is not finite, or a segment has zero length; give two different points"
        )


def refuse_degenerate_rows(
    points: Array, planes: Array, *, linear: bool = False, scale_known: bool = False
) -> None:
    """Raise if rows leave a motion free whatever the solution; return if they only have no real solution.

    Raises:
        InputError: a value is not finite.
        DegenerateGeometryError: the sentence names the motion.
    """
    refuse_not_finite(points, planes)
    motions = _free_parts(points, planes[:, :3], planes[:, 3])
    if scale_known:
        motions.pop("lines-through-one-point", None)
    if motions:
        code, motion = next(iter(motions.items()))
        raise DegenerateGeometryError(
            f"the correspondences leave {motion} free; add one that holds it", code=code
        )
    if linear:
        raise DegenerateGeometryError(
            "the rows do not determine the linear system; add lines in other directions",
            code="rank-deficient",
        )


def _rank_of_parts(x: Array, n: Array, d: Array) -> FreeMotion:
    motions = tuple(_free_parts(x, n, d).values())
    return FreeMotion(min(7 - len(motions), len(x)), motions)


def _free_parts(x: Array, n: Array, d: Array) -> dict[str, str]:
    motions = {}
    _, values, right = np.linalg.svd(n, full_matrices=True)
    values = np.pad(values, (0, 3))[:3]
    if values[2] <= RANK_TOLERANCE * values[0]:
        motions["parallel-lines"] = f"translation along {_text(right[2])}"
    else:
        meeting = np.linalg.lstsq(n, -d, rcond=None)[0]
        size = np.abs(d).max() + np.linalg.norm(meeting)
        if np.abs(n @ meeting + d).max() <= RANK_TOLERANCE * size:
            motions["lines-through-one-point"] = (
                f"growth about the point {_text(np.asarray(meeting, dtype=float))}"
            )
    _, spread, axes = np.linalg.svd(x - x.mean(axis=0), full_matrices=True)
    if len(spread) < 2 or spread[1] <= RANK_TOLERANCE * spread[0]:
        motions["points-on-one-line"] = f"rotation about the points' line along {_text(axes[0])} in the image"
    return motions


def _describe(motion: Array) -> str:
    parts = {"rotation about": motion[:3], "translation along": motion[3:6], "growth": motion[6:]}
    named = [
        name if name == "growth" else f"{name} {_text(part / np.linalg.norm(part))}"
        for name, part in parts.items()
        if np.linalg.norm(part) > 1e-3
    ]
    return " with ".join(named)


def _text(vector: Array) -> str:
    return "(" + ", ".join(f"{c:.3g}" for c in vector + 0.0) + ")"


def _rows(
    points: Array,
    planes: Array,
    each: int,
    lines: PointLineRows | None = None,
    spanned: SpannedRows | None = None,
) -> Rows:
    if len(points) != len(planes):
        raise InputError(f"sources and targets must pair up; got {len(points)} and {len(planes)} rows")
    first = np.arange(0, len(points) + 1, each, dtype=np.int32)
    return Rows(np.ascontiguousarray(points), np.ascontiguousarray(planes), first, lines, spanned=spanned)


def _numbers(values: ArrayLike, what: str) -> Array:
    array = np.ascontiguousarray(real_array(what, values))  # as the core takes them
    if np.any(np.abs(array) > LARGEST):
        raise InputError(f"{what} must be below {LARGEST:g} in size; got {np.abs(array).max():.3g}")
    return array


def _last(values: ArrayLike, size: int, what: str) -> Array:
    array = _numbers(values, what)
    if array.ndim != 2 or array.shape[1] != size:
        raise InputError(f"{what} must have shape (N, {size}); got {array.shape}")
    return array


def _segments(values: ArrayLike) -> Array:
    segments = _any_segments(values)
    if segments.ndim != 3:
        raise InputError(f"segments must have shape (N, 2, 3), two points on each line; got {segments.shape}")
    return segments


def _any_segments(values: ArrayLike) -> Array:
    array = _numbers(values, "segments")
    if array.shape[-2:] != (2, 3):
        raise InputError(f"segments must have shape (..., 2, 3), two points on each line; got {array.shape}")
    return array


@dataclass(frozen=True, eq=False)
class _Planes:
    """Planes (N, 4) of unit normals, and the points (N, 3, 3) that they were given by, if they were."""

    planes: Array
    points: Array | None

    def spanned(self, seen: Array) -> SpannedRows | None:
        """Points or lines that lie in them."""
        return None if self.points is None or len(seen) != len(self.points) else spanned(seen, self.points)


def _planes(values: ArrayLike) -> _Planes:
    array = _numbers(values, "planes")
    if array.ndim != 3:
        return _Planes(_unit_planes(array), None)
    if array.shape[1:] != (3, 3):
        raise InputError(
            f"planes must have shape (N, 4), or (N, 3, 3), three points on each plane; got {array.shape}"
        )
    normals = np.cross(array[:, 1] - array[:, 0], array[:, 2] - array[:, 0])
    offsets = -np.sum(normals * array[:, 0], axis=1)
    return _Planes(_unit_planes(np.column_stack([normals, offsets])), array)


def _unit_planes(values: ArrayLike) -> Array:
    planes = _last(values, 4, "planes")
    lengths = np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    if not np.all(lengths > 1.0 / LARGEST):
        raise InputError("a plane needs a normal of non-zero length")
    return np.asarray(planes / lengths)
