"""Frames with what was found in them: contact sheet of detections, overlay of the calibrated needle."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration
from sonocal.geometry import Array, segment_directions
from sonocal.report.style import DETECTED, TRACKED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["FrameImage", "needle_in_image", "needle_in_volume", "picture_svg", "plot_frame"]

MOST_PICTURES = 12
WIDEST_PX = 320


@dataclass(frozen=True, eq=False)
class FrameImage:
    """A frame to show.

    Attributes:
        image: (H, W), grey values; of a volume, the greatest along w.
        detected_px: (M, 2) or (M, 3): where the needle was found.
        segments_mm: (M, 2, 3): the tracked needle's, in the probe marker's frame, for the overlay; or None.
        title: such as "frame 12".
    """

    image: NDArray[np.uint8]
    detected_px: Array
    segments_mm: Array | None = None
    title: str = ""


def needle_in_image(calibration: Calibration, segments_mm: Array) -> Array:
    """Where lines (M, 2, 3) meet the image plane of a 2D probe, (M, 2) px; NaN for lines parallel to it."""
    transform = calibration.probe_from_image
    directions = segment_directions(segments_mm)
    normal = transform.rotation[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (transform.translation - segments_mm[:, 0]) @ normal / (directions @ normal)
        met = segments_mm[:, 0] + share[:, None] * directions
        local = (met - transform.translation) @ transform.rotation / transform.scales
    return np.asarray(np.where(np.isfinite(local), local, np.nan)[:, :2])


def needle_in_volume(calibration: Calibration, segments_mm: Array) -> Array:
    """The part (M, 2, 3), px, of segments (M, 2, 3) inside the volume of a 3D probe; NaN for those outside it.

    Source: Liang and Barsky 1984.
    """
    transform = calibration.probe_from_image
    start, end = np.moveaxis(
        (segments_mm - transform.translation) @ transform.rotation / transform.scales, 1, 0
    )
    along = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = (calibration.area_px[:, None] - start) / along  # (2, M, 3), of each face
    enter = np.maximum(np.nanmax(shares.min(axis=0), axis=1), 0.0)
    leave = np.minimum(np.nanmin(shares.max(axis=0), axis=1), 1.0)
    within = np.where(enter < leave, [enter, leave], np.nan).T[..., None]
    return np.asarray(start[:, None] + within * along[:, None])


def picture_svg(calibration: Calibration, frame: FrameImage) -> str:
    """A frame as inline SVG: detections as circles; the calibrated needle as a cross or line (paper fig. 8 c, d)."""
    height, width = frame.image.shape
    step = max(1, -(-width // WIDEST_PX))
    size = 0.02 * width
    marks = [
        f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{size:.1f}" class="found"/>'
        for u, v in frame.detected_px[:, :2]
    ]
    for path in _tracked(calibration, frame):
        if len(path) == 1:
            ((u, v),) = path
            strokes = f"M{u - size:.1f} {v:.1f}h{2 * size:.1f}M{u:.1f} {v - size:.1f}v{2 * size:.1f}"
        else:
            strokes = "M" + "L".join(f"{u:.1f} {v:.1f}" for u, v in path)
        marks.append(f'<path d="{strokes}" class="tracked"/>')
    # The origin is the centre of the first pixel.
    return (
        f'<svg viewBox="-0.5 -0.5 {width} {height}" role="img" class="picture">'
        f'<image x="-0.5" y="-0.5" width="{width}" height="{height}" preserveAspectRatio="none" '
        f'href="data:image/png;base64,{_png(frame.image[::step, ::step])}"/>{"".join(marks)}</svg>'
    )


def plot_frame(axis: Axes, calibration: Calibration, frame: FrameImage) -> None:
    """A frame with its detections as circles and the calibrated needle as a cross, of a 3D probe as a line.

    Source: the paper's figure 8 (c, d).
    """
    height, width = frame.image.shape
    axis.imshow(frame.image, cmap="gray", vmin=0, vmax=255)
    axis.plot(
        *frame.detected_px[:, :2].T, "o", markersize=8, fillstyle="none", color=DETECTED, label="detected"
    )
    for i, path in enumerate(_tracked(calibration, frame)):
        mark = "+" if len(path) == 1 else "-"
        axis.plot(*path.T, mark, markersize=8, color=TRACKED, label=None if i else "tracked")
    axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="u, px", ylabel="v, px")
    axis.set_title(frame.title)


def _tracked(calibration: Calibration, frame: FrameImage) -> list[Array]:
    """The calibrated needles in the picture: a point (1, 2) each, of a 3D probe two points (2, 2) seen along w."""
    if frame.segments_mm is None:
        return []
    # Rows of one needle share its segment.
    segments = np.unique(frame.segments_mm, axis=0)
    if calibration.dimension == 3:
        met = needle_in_volume(calibration, segments)[..., :2]
    else:
        met = needle_in_image(calibration, segments)[:, None]
    height, width = frame.image.shape
    inside = np.all((met >= -0.5) & (met <= [width - 0.5, height - 0.5]), axis=(1, 2))
    return list(met[inside])


def chosen_pictures(frames: Sequence[FrameImage]) -> list[FrameImage]:
    """At most twelve, spread over the recording."""
    index = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MOST_PICTURES)).astype(int))
    return [frames[i] for i in index] if len(frames) else []


def _png(image: NDArray[np.uint8]) -> str:
    from matplotlib.image import imsave

    buffer = io.BytesIO()
    imsave(buffer, image, cmap="gray", vmin=0, vmax=255, format="png")
    return base64.b64encode(buffer.getvalue()).decode()
