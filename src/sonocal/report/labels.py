"""Which dot was which wire: how often each wire was met, what else would fit, and images with the wires' numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration, LabelledDots, WireHits
from sonocal.calibration.labelled import next_best_in_words
from sonocal.errors import require
from sonocal.geometry import Array
from sonocal.registration import Association, RivalLabels
from sonocal.report.pictures import picture_of
from sonocal.report.style import DETECTED, TRACKED, UNUSED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["LabelSection", "label_section", "plot_labels", "telling_frames"]

# Larger than other pictures, which bear no numbers.
WIDEST_PX = 512
# Of an image's width.
MARK, UNUSED_MARK, LETTER = 0.018, 0.012, 0.05
# A wire's name stands beside its dot where all are as short; else its number in the table.
SHORT = 2


class LabelSection(NamedTuple):
    """What the page says of labels.

    Attributes:
        words: sentences.
        rows: the mark of each wire in the pictures, and how often it was met.
        pictures: titles and inline SVG.
    """

    words: list[str]
    rows: list[tuple[str, WireHits]]
    pictures: list[tuple[str, str]]


def label_section(
    calibration: Calibration, dots: LabelledDots, images: Mapping[int, NDArray[np.uint8]]
) -> LabelSection:
    """The part of the page that is of labels; `images` are some, by their numbers."""
    marks = _marks(dots)
    rows = list(zip(marks, dots.hits(calibration), strict=True))
    pictures = [(f"frame {frame}", _svg(calibration, dots, frame, image)) for frame, image in images.items()]
    return LabelSection(_in_words(dots), rows, pictures)


def telling_frames(dots: LabelledDots, most: int = 6) -> list[int]:
    """Numbers of images that show labels best: spread over those in which many dots take part."""
    used = np.array([np.count_nonzero(dots.wire[dots.frame == one] >= 0) for one in dots.frames])
    good = dots.frames[used >= max(1.0, float(np.median(used)))] if len(used) else dots.frames
    index = np.unique(np.linspace(0, len(good) - 1, min(len(good), most)).astype(int))
    return [int(good[i]) for i in index] if len(good) else []


def plot_labels(
    axis: Axes, calibration: Calibration, dots: LabelledDots, frame: int, image: NDArray[np.uint8]
) -> None:
    """An image with the dots of wires, which of them takes part as which wire, and where the wires should cross it.

    Args:
        axis: to draw on.
        calibration: of these dots.
        dots: see `sonocal.sweep.CandidateCalibration.labels`.
        frame: the image's number.
        image: (H, W), grey values.
    """
    require("calibration", calibration, Calibration)
    require("dots", dots, LabelledDots)
    shown, height, width = _shown(calibration, dots, frame, image), *image.shape
    axis.imshow(image, cmap="gray", vmin=0, vmax=255)
    axis.plot(*shown.unused.T, "s", markersize=5, fillstyle="none", color=UNUSED, label="takes no part")
    axis.plot(*shown.used.T, "o", markersize=8, fillstyle="none", color=DETECTED, label="takes part")
    axis.plot(*shown.crossings.T, "+", markersize=8, color=TRACKED, label="where a wire should be")
    for (u, v), mark, colour in shown.numbers:
        axis.annotate(mark, (u, v), (5, 5), textcoords="offset points", color=colour, weight="bold")
    axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="u, px", ylabel="v, px")
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=3)
    axis.set_title(f"frame {frame}")


class _Shown(NamedTuple):
    """Places (M, 2) px in one image, and what is written beside which: a place, a mark, its colour."""

    used: Array
    unused: Array
    crossings: Array
    numbers: list[tuple[Array, str, str]]
    tips: list[str]


def _shown(calibration: Calibration, dots: LabelledDots, frame: int, image: NDArray[np.uint8]) -> _Shown:
    marks, here = _marks(dots), np.flatnonzero(dots.frame == frame)
    used, unused = here[dots.wire[here] >= 0], here[dots.wire[here] < 0]
    met = dots.crossings_px(calibration, frame)
    height, width = image.shape
    inside = np.all((met >= -0.5) & (met <= [width - 0.5, height - 0.5]), axis=1)
    numbers = [(dots.points_px[row], marks[dots.wire[row]], DETECTED) for row in used]
    alone = np.setdiff1d(np.flatnonzero(inside), dots.wire[used])
    numbers += [(met[wire], marks[wire], TRACKED) for wire in alone]
    tips = [f"{dots.names[dots.wire[row]]}: {dots.residuals_mm[row]:.2f} mm from it" for row in used]
    return _Shown(dots.points_px[used], dots.points_px[unused], met[inside], numbers, tips)


def _svg(calibration: Calibration, dots: LabelledDots, frame: int, image: NDArray[np.uint8]) -> str:
    from markupsafe import escape

    shown, width = _shown(calibration, dots, frame, image), image.shape[1]
    size, small = MARK * width, UNUSED_MARK * width
    strokes = [_square(u, v, small) for u, v in shown.unused]
    strokes += [
        f'<path d="M{u - size:.1f} {v:.1f}h{2 * size:.1f}M{u:.1f} {v - size:.1f}v{2 * size:.1f}" class="tracked"/>'
        for u, v in shown.crossings
    ]
    strokes += [
        f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{size:.1f}" class="found"><title>{escape(tip)}</title></circle>'
        for (u, v), tip in zip(shown.used, shown.tips, strict=True)
    ]
    strokes += [_number(*one, width) for one in shown.numbers]
    return picture_of(image, strokes, WIDEST_PX)


def _square(u: float, v: float, half: float) -> str:
    side = f'width="{2 * half:.1f}" height="{2 * half:.1f}"'
    return f'<rect x="{u - half:.1f}" y="{v - half:.1f}" {side} class="unused"/>'


def _number(place: Array, mark: str, colour: str, width: int) -> str:
    """A wire's mark right below its dot, or left of it where the image ends."""
    from markupsafe import escape

    (u, v), beside, letter = place, MARK * width, LETTER * width
    ends = u + beside + len(mark) * letter > width
    at = f'x="{u - beside if ends else u + beside:.1f}" y="{v + beside + 0.6 * letter:.1f}"'
    look = f'style="font-size:{letter:.1f}px;stroke-width:{0.2 * letter:.1f}px"'
    anchor = ' text-anchor="end"' if ends else ""
    name = "of-found" if colour == DETECTED else "of-tracked"
    return f'<text {at}{anchor} {look} class="named {name}">{escape(mark)}</text>'


def _marks(dots: LabelledDots) -> list[str]:
    """What stands beside the dots: numbers as in the contact sheet, or names that are as short."""
    if all(len(name) <= SHORT for name in dots.names):
        return list(dots.names)
    return [str(i + 1) for i in range(len(dots.names))]


def _in_words(dots: LabelledDots) -> list[str]:
    one = dots.association
    used, count, wires = int(np.count_nonzero(dots.wire >= 0)), len(dots.wire), len(dots.names)
    first = f"{used} of {count} dots take part, each as a dot of one of {wires} wires, and nobody said which"
    return [f"{first}: {_verdict(one)}", next_best_in_words(one) + _further(one.second)]


def _verdict(one: Association) -> str:
    if one.verdict == "found":
        return f"labels are sure; {one.reason}"
    words = "labels are open" if one.verdict == "ambiguous" else "labels are not sure"
    return f"{words}; {one.reason}"


def _further(second: RivalLabels | None) -> str:
    if second is None:
        return ""
    other = f"; it names {100 * second.share_of_labels:.0f} % of the dots otherwise"
    return other + (
        f"; to tell the two apart, {second.view}: their dots part by {second.view_apart_mm:.0f} mm"
        if second.view
        else "; no view that was tried tells the two apart"
    )
