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
from sonocal.errors import require
from sonocal.geometry import Array, needle_in_image, needle_in_volume
from sonocal.geometry.shown import brief
from sonocal.report.style import DETECTED, TRACKED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["FrameImage", "picture_of", "picture_svg", "plot_frame"]

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

    __repr__ = brief


def picture_svg(calibration: Calibration, frame: FrameImage) -> str:
    """A frame as inline SVG: detections as circles; the calibrated needle as a cross or line (paper fig. 8 c, d)."""
    size = 0.02 * frame.image.shape[1]
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
    return picture_of(frame.image, marks, WIDEST_PX)


def picture_of(image: NDArray[np.uint8], marks: Sequence[str], widest_px: int) -> str:
    """A grey image (H, W) as inline SVG, thinned to a width, with marks over it."""
    height, width = image.shape
    step = max(1, -(-width // widest_px))
    # The origin is the centre of the first pixel.
    return (
        f'<svg viewBox="-0.5 -0.5 {width} {height}" role="img" class="picture">'
        f'<image x="-0.5" y="-0.5" width="{width}" height="{height}" preserveAspectRatio="none" '
        f'href="data:image/png;base64,{_png(image[::step, ::step])}"/>{"".join(marks)}</svg>'
    )


def plot_frame(axis: Axes, calibration: Calibration, frame: FrameImage) -> None:
    """A frame with its detections as circles and the calibrated needle as a cross, of a 3D probe as a line.

    Source: the paper's figure 8 (c, d).
    """
    require("calibration", calibration, Calibration)
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
        met = needle_in_volume(calibration.probe_from_image, calibration.area_px, segments)
    else:
        met = needle_in_image(calibration.probe_from_image, segments)[:, None]
    if calibration.sound is not None:  # the picture is as scanned
        met = calibration.sound.in_image(met.reshape(-1, calibration.dimension)).reshape(met.shape)
    met = met[..., :2]
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
