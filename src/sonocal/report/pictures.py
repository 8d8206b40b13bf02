"""Frames with what was found in them: contact sheet of detections, overlay of the calibrated needle."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration
from sonocal.geometry import Array, segment_directions

__all__ = ["FrameImage", "needle_in_image", "picture_svg"]

MOST_PICTURES = 12
WIDEST_PX = 320


@dataclass(frozen=True, eq=False)
class FrameImage:
    """A frame to show.

    Attributes:
        image: (H, W), grey values.
        detected_px: (M, 2): where the needle was found.
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


def picture_svg(calibration: Calibration, frame: FrameImage) -> str:
    """A frame as inline SVG: detections as circles; the calibrated needle as a cross (paper fig. 8 d)."""
    height, width = frame.image.shape
    step = max(1, -(-width // WIDEST_PX))
    size = 0.02 * width
    marks = [
        f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{size:.1f}" class="found"/>' for u, v in frame.detected_px
    ]
    if frame.segments_mm is not None and calibration.dimension == 2:
        for u, v in needle_in_image(calibration, frame.segments_mm):
            if np.isfinite(u) and 0 <= u < width and 0 <= v < height:
                path = f"M{u - size:.1f} {v:.1f}h{2 * size:.1f}M{u:.1f} {v - size:.1f}v{2 * size:.1f}"
                marks.append(f'<path d="{path}" class="tracked"/>')
    # The origin is the centre of the first pixel.
    return (
        f'<svg viewBox="-0.5 -0.5 {width} {height}" role="img" class="picture">'
        f'<image x="-0.5" y="-0.5" width="{width}" height="{height}" preserveAspectRatio="none" '
        f'href="data:image/png;base64,{_png(frame.image[::step, ::step])}"/>{"".join(marks)}</svg>'
    )


def chosen_pictures(frames: Sequence[FrameImage]) -> list[FrameImage]:
    """At most twelve, spread over the recording."""
    index = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MOST_PICTURES)).astype(int))
    return [frames[i] for i in index] if len(frames) else []


def _png(image: NDArray[np.uint8]) -> str:
    from matplotlib.image import imsave

    buffer = io.BytesIO()
    imsave(buffer, image, cmap="gray", vmin=0, vmax=255, format="png")
    return base64.b64encode(buffer.getvalue()).decode()
