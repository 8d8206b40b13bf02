"""Poses of rigid bodies from the places of their markers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from sonocal.errors import InputError
from sonocal.findings import Diagnostic
from sonocal.geometry import FURTHEST, Array
from sonocal.geometry.fitted import fitted_motions
from sonocal.recording.poses import Mask, Poses
from sonocal.targets import Point

__all__ = ["Markers", "bodies_from_markers", "check_markers", "rigid_fits"]

Markers = Sequence[Point]
"""Where markers are: each a point, called as the marker, in its tool's frame."""

FEWEST = 3
# Markers closer to one line than this do not tell how a body turned about it, mm.
LEAST_WIDTH_MM = 1.0
# Of the root mean square over a usual frame: what is further off is another body, or labels that were exchanged.
MOST_RESIDUAL_MM = 3.0


def check_markers(given: object) -> Markers:
    """What says where markers are, as it must be.

    Raises:
        InputError: it is no list of points.
    """
    markers = tuple(given) if isinstance(given, Iterable) else (given,)
    if all(isinstance(one, Point) for one in markers):
        return markers
    raise InputError(f"markers must be a list of points (see targets.read_points_toml); got {given!r}"[:200])


def bodies_from_markers(
    places_mm: Mapping[str, Array], model: Markers, name: str
) -> tuple[list[Poses], list[Diagnostic]]:
    """The poses of tools whose markers are labelled ``Tool:marker``, or named in a model, and how well they fit.

    Args:
        places_mm: (N, 3) of each marker in the tracker's frame; NaN where it was not seen.
        model: where the markers are in their tools' frames. Without it, a tool's frame has the tracker's directions
            and the markers' middle as its origin, in the first of the frames that show most of them.
        name: of the recording, for messages.

    Raises:
        InputError: no tool has three markers, they do not move as one body, or one is absurdly far away.
    """
    poses, notes = [], []
    for tool, labels in _tools(places_mm, model, name).items():
        places = np.stack([places_mm[label] for label in labels.values()], axis=1)
        _refuse_distant(places, list(labels.values()), name)
        if model:
            shape, source = np.array([_place(model, tool, marker) for marker in labels]), "the model given"
        else:
            shape, source = _shape(places), "the recording itself"
        matrices, residuals = rigid_fits(shape, places)
        seen = np.isfinite(residuals)
        usual = float(np.median(residuals[seen])) if seen.any() else 0.0
        if usual > MOST_RESIDUAL_MM:
            raise InputError(
                f"{name}: the markers of {tool} ({', '.join(labels)[:80]}) are {usual:.1f} mm from one rigid body in a "
                "usual frame; check their labels and the unit of the model"
            )
        poses.append(Poses.of(tool, "Tracker", matrices))
        notes.append(_note(tool, len(labels), residuals[seen], source))
    return poses, notes


def rigid_fits(shape_mm: Array, places_mm: Array) -> tuple[Array, Array]:
    """The rigid motion of each frame that carries a shape to the markers that were seen, by least squares.

        min over R, t of sum |R s_i + t - p_i|^2

    Args:
        shape_mm: (M, 3).
        places_mm: (N, M, 3); NaN where a marker was not seen.

    Returns:
        (N, 4, 4) and the residual's root mean square (N,), mm; NaN where fewer than three markers that do not lie on
        one line were seen.

    Source: Umeyama 1991, without scale.
    """
    matrices = np.full((len(places_mm), 4, 4), np.nan)
    residuals = np.full(len(places_mm), np.nan)
    seen = np.asarray(np.isfinite(places_mm).all(axis=2) & np.isfinite(shape_mm).all(axis=1))
    for pattern, frames in _patterns(seen):
        if pattern.sum() < FEWEST or _width(shape_mm[pattern]) < LEAST_WIDTH_MM:
            continue
        found, left = _fits(shape_mm[pattern], places_mm[frames][:, pattern])
        matrices[frames], residuals[frames] = found, left
    return matrices, residuals


def _fits(shape: Array, places: Array) -> tuple[Array, Array]:
    matrices = fitted_motions(np.broadcast_to(shape, places.shape), places)
    off = shape @ np.swapaxes(matrices[:, :3, :3], 1, 2) + matrices[:, None, :3, 3] - places
    return matrices, np.sqrt((off**2).sum(axis=2).mean(axis=1))


def _patterns(seen: Mask) -> Iterator[tuple[Mask, Array]]:
    """Which markers were seen together, and in which frames."""
    patterns, of = np.unique(seen, axis=0, return_inverse=True)
    order = np.argsort(of.reshape(-1), kind="stable")
    ends = np.cumsum(np.bincount(of.reshape(-1), minlength=len(patterns)))[:-1]
    yield from zip(patterns, np.split(order, ends), strict=True)


def _tools(places: Mapping[str, Array], model: Markers, name: str) -> dict[str, dict[str, str]]:
    """The markers of each tool: their names in the model, and their labels in the recording."""
    tools: dict[str, dict[str, str]] = {}
    for point in model:
        for label in (f"{point.frame}:{point.name}", point.name):
            if label in places:
                tools.setdefault(point.frame, {})[point.name] = label
                break
    if not model:
        for label in places:
            tool, colon, marker = label.partition(":")
            if colon and tool and marker:
                tools.setdefault(tool, {})[marker] = label
    whole = {tool: labels for tool, labels in tools.items() if len(labels) >= FEWEST}
    if not whole:
        have = ", ".join(places)[:200] or "none"
        raise InputError(
            f"{name}: no tool has {FEWEST} markers or more; label them Tool:marker, or say with --markers which are of "
            f"one tool; the labels are {have}"
        )
    return whole


def _shape(places: Array) -> Array:
    """(M, 3): the markers in the first frame that shows most of them, about their middle; NaN of those it lacks."""
    seen = np.isfinite(places).all(axis=2).sum(axis=1)
    first = places[int(np.argmax(seen))] if len(places) else np.full(places.shape[1:], np.nan)
    known = np.isfinite(first).all(axis=1)
    return np.asarray(first - first[known].mean(axis=0) if known.any() else first)


def _refuse_distant(places: Array, labels: Sequence[str], name: str) -> None:
    far = np.argwhere(np.abs(places) >= FURTHEST)
    if len(far):
        frame, marker, axis = far[0]
        raise InputError(
            f"{name}, frame {frame}: the marker {labels[marker][:40]} lies at {places[frame, marker, axis]:g} mm; "
            "leave out markers that were not seen"
        )


def _place(model: Markers, tool: str, marker: str) -> Array:
    return next(point.place_mm for point in model if (point.frame, point.name) == (tool, marker))


def _width(shape: Array) -> float:
    """How far points are from one line, mm; nothing where one is not known."""
    if not np.isfinite(shape).all():
        return 0.0
    return float(np.linalg.svd(shape - shape.mean(axis=0), compute_uv=False)[1])


def _note(tool: str, count: int, residuals: Array, source: str) -> Diagnostic:
    usual, most = (float(np.median(residuals)), float(residuals.max())) if len(residuals) else (0.0, 0.0)
    own = source == "the recording itself"
    return Diagnostic(
        code="marker-fit",
        severity="info",
        message=(
            f"{tool}: {count} markers were fitted to {source}, {usual:.2f} mm (root mean square) off in a usual frame "
            f"and {most:.2f} mm at most, in {len(residuals)} frames"
        ),
        advice=(
            "the tool's frame is of this recording alone: give --markers where another recording must share it"
            if own
            else "a marker that is loose, or in another place than the model says, shows here"
        ),
    )
