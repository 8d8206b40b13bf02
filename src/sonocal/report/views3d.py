"""Three-dimensional figures in the probe marker's frame, each on a matplotlib 3D axis that the caller gives."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sonocal.calibration import Calibration
from sonocal.errors import UnsupportedError, require
from sonocal.geometry import (
    Array,
    AxisScaled,
    Similarity,
    area_places,
    homogeneous_points,
    segment_directions,
)
from sonocal.observations import Observations
from sonocal.registration.uncertainty import point_jacobian, weakest_motion
from sonocal.report.style import AXES, FAINT, FITTED, HELD_OUT, INK

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

__all__ = ["plot_frames", "plot_matrix", "plot_needles", "plot_weak_motion"]

MOST_NEEDLES = 120


def plot_frames(axis: Axes3D, calibration: Calibration) -> None:
    """The marker's axes and the image where the calibration puts it: what the matrix means."""
    require("calibration", calibration, Calibration)
    edge = _image_edge(calibration)
    _draw_image(axis, calibration, FITTED)
    _draw_marker(axis, calibration, edge)
    axis.set_title("The matrix drawn: marker and image")


def plot_matrix(
    axis: Axes3D,
    probe_from_image: AxisScaled | Similarity,
    area_px: Array,
    ours: Calibration | None = None,
) -> None:
    """The marker's axes and the image where a matrix of other software puts it, and where ours does.

    Args:
        axis: to draw on.
        probe_from_image: of the matrix.
        area_px: (2, d): of the image.
        ours: our own calibration, dashed.
    """
    theirs = _Placed(probe_from_image, area_px)
    edge = _image_edge(theirs)
    if ours is not None:
        outline = _image_edge(ours)
        # Broad, so that it shows where the two lie on one another.
        axis.plot(*outline.T, color=HELD_OUT, linewidth=3.5, linestyle="--", label="our own calibration")
        edge = np.vstack([edge, outline])
    _draw_image(axis, theirs, FITTED, "this matrix")
    _draw_marker(axis, theirs, edge)
    axis.legend(loc="upper left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.0)
    axis.set_title("The matrix drawn: marker and image")


def plot_needles(axis: Axes3D, calibration: Calibration, observations: Observations) -> None:
    """Needle poses through the image, in the probe marker's frame: places and tilts that were scanned."""
    require("calibration", calibration, Calibration)
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    rows = observations.select(
        np.unique(np.linspace(0, len(observations) - 1, min(len(observations), MOST_NEEDLES)).astype(int))
    )
    edge = _image_edge(calibration)
    reach = 0.35 * float(np.ptp(edge, axis=0).max())
    directions = segment_directions(rows.segments_mm)
    mapped = calibration.probe_from_image @ homogeneous_points(rows.points_px)
    along = np.sum((mapped - rows.segments_mm[:, 0]) * directions, axis=1, keepdims=True)
    feet = rows.segments_mm[:, 0] + along * directions
    pieces = np.stack([feet - reach * directions, feet + reach * directions], axis=1)
    axis.add_collection3d(Line3DCollection(list(pieces), colors=HELD_OUT, linewidths=0.6, alpha=0.6))
    axis.scatter(*mapped.T, color=FITTED, s=4, depthshade=False)
    _draw_image(axis, calibration, INK)
    _finish(axis, np.vstack([edge, pieces.reshape(-1, 3)]))
    axis.set_title("Needle poses through the image")


def plot_weak_motion(axis: Axes3D, calibration: Calibration) -> None:
    """The image and where the loosest motion would carry it, many times enlarged.

    Raises:
        UnsupportedError: the calibration has no covariance.
    """
    require("calibration", calibration, Calibration)
    if calibration.covariance is None:
        raise UnsupportedError("a calibration without covariance has no weakest motion to draw")
    corners = area_places(calibration.area_px)[:-1]
    motion = weakest_motion(calibration.probe_from_image, calibration.covariance, corners)
    edge = _image_edge(calibration)
    enlarged = 0.12 * float(np.ptp(edge, axis=0).max()) / max(motion.rms_mm, 1e-9)
    jacobian = point_jacobian(
        calibration.probe_from_image, _edge_px(calibration), len(calibration.covariance)
    )
    _draw_image(axis, calibration, INK)
    for sign, colour, name in ((1.0, HELD_OUT, "moved one way"), (-1.0, FITTED, "and the other")):
        moved = edge + sign * enlarged * (jacobian @ motion.tangent)
        axis.plot(*moved.T, color=colour, linewidth=1.2, linestyle="--", label=name)
    _finish(axis, edge)
    axis.legend(loc="upper left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.0)
    axis.set_title(f"Loosest motion, {enlarged:.0f} times enlarged")


def _draw_marker(axis: Axes3D, placed: Calibration | _Placed, edge: Array) -> None:
    """The marker's axes, as long as suits what is drawn, and a line from it to the first pixel."""
    size = float(np.ptp(np.vstack([edge, np.zeros(3)]), axis=0).max())
    for direction, colour, name in zip(np.eye(3), AXES, "xyz", strict=True):
        axis.plot(*np.stack([np.zeros(3), 0.25 * size * direction]).T, color=colour, linewidth=2)
        axis.text(*(0.3 * size * direction), name, color=colour)
    axis.text(0, 0, -0.08 * size, "marker", ha="center")
    origin = placed.probe_from_image @ np.zeros(placed.dimension)
    axis.plot(*np.stack([np.zeros(3), origin]).T, color=FAINT, linewidth=1, linestyle=":")
    _finish(axis, np.vstack([edge, np.zeros(3), 0.3 * size * np.eye(3)]))


class _Placed(NamedTuple):
    """An area of the image where a matrix puts it: what is drawn of a calibration."""

    probe_from_image: AxisScaled | Similarity
    area_px: Array

    @property
    def dimension(self) -> int:
        return int(self.area_px.shape[1])


def _edge_px(calibration: Calibration | _Placed) -> Array:
    """The outline of the image (of a 3D probe: of its first and last slice), a closed path, px."""
    low, high = calibration.area_px
    square = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]), (low[0], low[1])]
    depths = (low[2], high[2]) if calibration.dimension == 3 else (0.0,)
    return np.array([(u, v, w) for w in depths for u, v in square])


def _image_edge(calibration: Calibration | _Placed) -> Array:
    return np.asarray(calibration.probe_from_image @ _edge_px(calibration))


def _draw_image(axis: Axes3D, calibration: Calibration | _Placed, colour: str, label: str = "") -> None:
    path = _edge_px(calibration)
    edge = np.asarray(calibration.probe_from_image @ path)
    axis.plot(*edge.T, color=colour, linewidth=1.2, **({"label": label} if label else {}))
    if len(path) > 5:
        for i in range(1, 4):
            axis.plot(*edge[[i, i + 5]].T, color=colour, linewidth=1.2)
    for end, other, name in ((1, 3, "u"), (3, 1, "v")):
        along, across = path[end] - path[0], path[other] - path[0]
        # The name stands outside the image, where neither the arrow nor its head is in any view.
        places = path[0] + np.stack([0.0 * along, 0.35 * along, 0.2 * along - 0.14 * across])
        start, tip, beside = np.asarray(calibration.probe_from_image @ places)
        axis.quiver(*start, *(tip - start), color=colour, linewidth=1.6, arrow_length_ratio=0.25)
        axis.text(*beside, name, color=colour, ha="center", va="center")


def _finish(axis: Axes3D, points: Array) -> None:
    """Equal units on all axes, and quiet panes."""
    centre, half = (points.max(0) + points.min(0)) / 2, float(np.ptp(points, axis=0).max()) / 2
    axis.set(
        xlim=(centre[0] - half, centre[0] + half),
        ylim=(centre[1] - half, centre[1] + half),
        zlim=(centre[2] - half, centre[2] + half),
        xlabel="x, mm",
        ylabel="y, mm",
        zlabel="z, mm",
    )
    axis.set_box_aspect((1, 1, 1), zoom=0.9)
    axis.locator_params(nbins=5)
    for side in (axis.xaxis, axis.yaxis, axis.zaxis):
        side.pane.set_facecolor("none")
        side.pane.set_edgecolor(FAINT)
