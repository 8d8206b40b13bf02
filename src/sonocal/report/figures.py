"""Figures over the image and over time, each on a matplotlib axis that the caller gives."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sonocal.calibration import Calibration, line_distances
from sonocal.errors import require
from sonocal.geometry import Array, homogeneous_points, segment_directions
from sonocal.observations import Observations
from sonocal.registration.noise import residual_vectors
from sonocal.registration.uncertainty import radius_95
from sonocal.report.style import ACROSS, ERROR_MAP, FITTED, HELD_OUT, INK, ON_MAP, OUTLIER

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "plot_predicted_error",
    "plot_residuals_by_frame",
    "plot_residuals_over_image",
    "plot_tilts",
]

# More marks than this make a slow page and no clearer picture.
MOST_MARKS, MOST_ARROWS = 400, 200
GRID = 41
# Below the image, so that wide images keep their width.
BAR: Any = {"location": "bottom", "shrink": 0.7, "aspect": 30, "fraction": 0.05, "pad": 0.17}


def plot_predicted_error(
    axis: Axes, calibration: Calibration, observations: Observations | None = None
) -> None:
    """The error that 95 % stay below over the image, in mm; of a 3D probe, over its middle slice.

    Args:
        axis: to draw on.
        calibration: with a covariance.
        observations: where the needle was seen, drawn as dots.

    Raises:
        UnsupportedError: the calibration has no covariance.
    """
    require("calibration", calibration, Calibration)
    low, high = calibration.area_px
    u, v = (np.linspace(low[i], high[i], GRID) for i in (0, 1))
    places = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    if calibration.dimension == 3:
        places = np.column_stack([places, np.full(len(places), (low[2] + high[2]) / 2)])
    below = radius_95(calibration.predict(places)[1], calibration.noise.freedom).reshape(GRID, GRID)
    filled = axis.contourf(u, v, below, levels=_round_levels(below), cmap=ERROR_MAP)
    axis.figure.colorbar(filled, ax=axis, label="95 % of errors are below, mm", **BAR)
    if observations is not None:
        seen = observations.points_px[_thinned(len(observations))]
        axis.plot(seen[:, 0], seen[:, 1], ".", color=ON_MAP, markersize=2, alpha=0.6)
    _image_axes(axis, calibration)
    where = f", slice w = {(low[2] + high[2]) / 2:.0f} px" if calibration.dimension == 3 else ""
    axis.set_title(f"Predicted error over the {calibration.area_name}{where}")


def plot_residuals_over_image(axis: Axes, calibration: Calibration, observations: Observations) -> None:
    """Residuals as arrows where the needle was seen, in the image plane; colour tells the part across it.

    A pattern (all outwards, all turned one way) is a systematic error; hair in all directions is noise.
    """
    require("calibration", calibration, Calibration)
    from matplotlib.colors import LinearSegmentedColormap

    chosen = _agreeing(calibration, observations)
    chosen = chosen.select(_thinned(len(chosen), MOST_ARROWS))
    residuals = _in_image(calibration, chosen)
    size = float(np.ptp(calibration.area_px[:, :2], axis=0).max())
    typical = float(np.sqrt(np.mean(residuals**2))) or 1.0
    limit = 2.5 * typical
    mm_per_px = typical / (0.06 * size)
    drawn = axis.quiver(
        *chosen.points_px[:, :2].T,
        residuals[:, 0],
        residuals[:, 1],
        residuals[:, 2],
        angles="xy",
        scale_units="xy",
        scale=mm_per_px,
        cmap=LinearSegmentedColormap.from_list("across", ACROSS),
        clim=(-limit, limit),
        width=0.004,
    )
    axis.quiverkey(
        drawn, 0.78, 1.045, typical, f"{typical:.2f} mm", labelpos="E", color=INK, fontproperties={"size": 8}
    )
    axis.figure.colorbar(drawn, ax=axis, label="across the image plane, mm", **BAR)
    tips = chosen.points_px[:, :2] + residuals[:, :2] / mm_per_px
    left_out = _left_out(calibration, observations)
    if len(left_out):  # their residuals are arrows across the page
        axis.plot(*left_out.T, "x", color=OUTLIER, markersize=5, clip_on=False, label="left out")
    _image_axes(axis, calibration, tips)
    axis.set_title("Residuals")


def plot_residuals_by_frame(
    axis: Axes,
    calibration: Calibration,
    observations: Observations,
    held_out: Observations | None = None,
) -> None:
    """Distance of mapped points to their lines, frame after frame: drift, slips and bad frames show here.

    Args:
        axis: to draw on.
        calibration: the calibration.
        observations: rows that were fitted, outliers included, or any others.
        held_out: further rows, drawn after them.
    """
    require("calibration", calibration, Calibration)
    distances = line_distances(calibration.probe_from_image, observations)
    threshold = calibration.threshold_mm
    agree = distances <= threshold
    top = 1.3 * max(float(distances[agree].max(initial=calibration.fit.rms_mm)), 1e-3)
    axis.plot(
        observations.frame[agree],
        distances[agree],
        ".",
        color=FITTED,
        markersize=4,
        label="rows" if held_out is None else "fitted",
    )
    if not agree.all():
        # Outliers may be metres off: they stand at the top edge.
        axis.plot(
            observations.frame[~agree],
            np.full((~agree).sum(), 0.98 * top),
            "x",
            color=OUTLIER,
            markersize=5,
            label=f"beyond {threshold:g} mm",
        )
    if held_out is not None:
        unseen = line_distances(calibration.probe_from_image, held_out)
        top = max(top, 1.1 * float(np.quantile(unseen, 0.98)))
        after = int(observations.frame.max()) + 1 - int(held_out.frame.min())
        axis.plot(
            held_out.frame + after, unseen, ".", color=HELD_OUT, markersize=4, alpha=0.7, label="held out"
        )
    axis.axhline(calibration.fit.rms_mm, color=FITTED, linewidth=1, linestyle="--")
    axis.set(
        xlabel="frame" if held_out is None else "frame, the held-out ones after the fitted",
        ylabel="distance, mm",
        ylim=(0, top),
    )
    axis.grid(axis="y")
    # Above the axis: outliers stand at its upper edge.
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=3)
    axis.set_title(f"Residuals by frame (fitted: {calibration.fit.rms_mm:.2f} mm rms, dashed)")


def plot_tilts(axis: Axes, calibration: Calibration, observations: Observations) -> None:
    """The needle's directions seen from the image's normal, on a polar axis: angle to it, and which way.

    Dots in one heap leave a rotation loose; dots spread to 30 degrees and more in two directions hold it.
    """
    require("calibration", calibration, Calibration)
    chosen = _agreeing(calibration, observations)
    rotation = calibration.probe_from_image.rotation
    along = segment_directions(chosen.segments_mm[_thinned(len(chosen))]) @ rotation
    along *= np.where(along[:, 2:] < 0, -1.0, 1.0)
    tilt = np.degrees(np.arccos(np.clip(along[:, 2], 0, 1)))
    axis.plot(np.arctan2(along[:, 1], along[:, 0]), tilt, ".", color=FITTED, markersize=4, alpha=0.7)
    axis.set_ylim(0, 90)
    axis.set_yticks([30, 60, 90], ["30°", "60°", ""])
    # Outside the circle, where nothing crosses it.
    axis.text(np.radians(45), 98, "90°", ha="left", va="top", fontsize="small")
    axis.set_xticks(np.pi / 2 * np.arange(4), ["u", "v", "-u", "-v"])
    # v points down in the image.
    axis.set_theta_direction(-1)  # type: ignore[attr-defined]
    axis.set_title("Needle tilts from the image's normal")


def _image_axes(axis: Axes, calibration: Calibration, shown_px: Array | None = None) -> None:
    """The image's area, u right and v down, widened to hold further points (N, 2) that are drawn."""
    low, high = calibration.area_px[:, :2]
    pad = 0.03 * (high - low)
    if shown_px is not None:
        low, high = np.minimum(low, shown_px.min(axis=0)), np.maximum(high, shown_px.max(axis=0))
    axis.set(xlim=(low[0] - pad[0], high[0] + pad[0]), ylim=(high[1] + pad[1], low[1] - pad[1]))
    axis.set(xlabel="u, px", ylabel="v, px", aspect="equal")


def _round_levels(values: Array) -> Array:
    """About ten levels around values, at numbers that one would write."""
    from matplotlib.ticker import MaxNLocator

    return np.asarray(
        MaxNLocator(10, steps=[1, 2, 5, 10]).tick_values(float(values.min()), float(values.max()))
    )


def _left_out(calibration: Calibration, observations: Observations) -> Array:
    """Pixels (M, 2) within the image's area of rows beyond the threshold, where others agree."""
    beyond = line_distances(calibration.probe_from_image, observations) > calibration.threshold_mm
    if beyond.all():  # rows of another scan are drawn as arrows
        return np.empty((0, 2))
    low, high = calibration.area_px[:, :2]
    seen = observations.points_px[beyond][:, :2]
    seen = seen[np.all((seen >= low) & (seen <= high), axis=1)]
    return seen[_thinned(len(seen))] if len(seen) else seen


def _agreeing(calibration: Calibration, observations: Observations) -> Observations:
    threshold = calibration.threshold_mm
    agree = line_distances(calibration.probe_from_image, observations) <= threshold
    # Rows of another scan may all be far off; then that is what there is to see.
    return observations.select(agree) if agree.any() else observations


def _in_image(calibration: Calibration, rows: Observations) -> Array:
    """Residual vectors (N, 3) in mm along the image's axes u, v and its normal."""
    transform = calibration.probe_from_image
    vectors = residual_vectors(transform, homogeneous_points(rows.points_px), rows.segments_mm)
    return np.asarray(vectors @ transform.rotation)


def _thinned(count: int, most: int = MOST_MARKS) -> Array:
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(int))
