"""Figures of a study: boxes in the paper's form, or a curve over a factor."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sonocal.errors import UnsupportedError
from sonocal.geometry import Array
from sonocal.report.style import FAINT, INK, RC
from sonocal.studies.definition import Study
from sonocal.studies.measures import ERRORS, QUANTITIES
from sonocal.studies.store import Store
from sonocal.studies.summary import BOUND, Row, errors_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["figure_png"]

# By method, and told apart in grey too; what is ours is blue, what is linear is orange.
COLOURS = {
    "5point2D": "#d9730d",
    "3line3D": "#d9730d",
    "2line3D": "#2e8b57",
    "4point2D": "#9c6ade",
    "four_points": "#6fb1e0",
    "two_lines": "#6fb1e0",
    "sonocal": "#1f5fa8",
    BOUND: "#8a8f98",
}
SERIES = ("#1f5fa8", "#d9730d", "#2e8b57", "#9c6ade", "#c0392b", "#50555d")
NAMES = {
    "dimension": "{:g}D probe",
    "needles": "{:g} needles",
    "needle_mm": "needle of {:g} mm",
    "tilt_deg": "tilts to {:g}°",
    "depth_mm": "{:g} mm deep",
    "sigma_mm": "{:g} mm at the ends",
    "sigma_px": "{:g} px",
    "latency_ms": "{:g} ms late",
    "speed_mm_s": "{:g} mm/s",
    "outlier_share": "outliers {:.0%}",
}
AXES = {
    "needles": "needle poses",
    "needle_mm": "length of the needle, mm",
    "tilt_deg": "greatest tilt from the image's normal, deg",
    "depth_mm": "depth of the target, mm",
    "sigma_mm": "noise of the needle's ends along each axis, mm",
    "sigma_px": "noise of the image point along each axis, px",
    "latency_ms": "latency of the tracker, ms",
    "outlier_share": "share of outliers",
}
MOST_OUTLIERS = 60
PANEL_IN = (4.0, 2.9)


def figure_png(store: Store, rows: list[Row], dpi: int = 110) -> bytes:
    """The figure of a study as a PNG.

    Raises:
        UnsupportedError: matplotlib is not installed.
    """
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure
    except ImportError:
        raise UnsupportedError(
            "figures need matplotlib, which is not installed; pip install 'sonocal[report]'"
        ) from None
    study = store.study
    form = study.figure
    across = len(form.quantities)
    stages = form.stages if form.form == "boxes" else form.stages[-1:]
    with mpl.rc_context(RC):
        width, height = max(PANEL_IN[0] * across, 5.5), PANEL_IN[1] * len(stages) + 0.75
        figure = Figure(figsize=(width, height))
        grid = figure.subplots(len(stages), across, squeeze=False)
        # Fixed margins, in inches: laying out by what is drawn takes half of the time.
        figure.subplots_adjust(
            left=0.65 / width,
            right=1 - 0.3 / width,
            bottom=0.9 / height,
            top=1 - 0.6 / height,
            wspace=0.24,
            hspace=0.42,
        )
        for axes, stage in zip(grid, stages, strict=True):
            for axis, quantity in zip(axes, form.quantities, strict=True):
                if form.form == "boxes":
                    _draw_boxes(axis, store, stage, quantity)
                else:
                    _draw_curves(axis, study, rows, stage, quantity)
                axis.set_ylabel(QUANTITIES[quantity])
                axis.grid(axis="y")
                axis.set_axisbelow(True)
        handles, labels = grid[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=min(len(labels), 6))
        figure.suptitle(
            study.title, x=0.1 / width, y=1 - 0.1 / height, ha="left", va="top", fontweight="bold"
        )
        content = io.BytesIO()
        figure.savefig(content, dpi=dpi, format="png", metadata={"Software": None})
    return content.getvalue()


def _draw_boxes(axis: Axes, store: Store, stage: str, quantity: str) -> None:
    """Median, quartiles, whiskers to the last value within 1.5 quartile distances, and outliers, by level."""
    study, cells = store.study, store.study.cells()
    methods = [*study.methods, *([BOUND] if quantity in ERRORS else [])]
    width, least = 0.8 / len(methods), np.inf
    for m, method in enumerate(methods):
        at, boxes = [], []
        for index, cell in enumerate(cells):
            if method != BOUND and method not in cell.methods:
                continue
            values = errors_of(store, index, method, stage, quantity)
            values = values[np.isfinite(values)]
            if len(values):
                boxes.append(_Box.of(values))
                at.append(index + (m - (len(methods) - 1) / 2) * width)
        if boxes:
            _boxes(axis, boxes, at, 0.85 * width, label=method)
            least = min(least, *(box.q1 for box in boxes))
    labels = [
        ", ".join(_level_text(n, v, len(cell.levels)) for n, v in cell.levels.items()) for cell in cells
    ]
    axis.set_xticks(range(len(cells)), labels)
    axis.set_xlim(-0.5, len(cells) - 0.5)
    if len(study.factors) == 1:
        name = next(iter(study.factors))
        axis.set_xlabel(AXES.get(name, name))
    if study.figure.log:
        axis.set_yscale("log")
        axis.minorticks_off()
        axis.set_ylim(bottom=least / 5)  # how small the least errors are is of no interest
    else:
        axis.set_ylim(bottom=0)
    axis.set_title(f"{stage} refinement")


def _level_text(name: str, level: float, factors: int) -> str:
    return f"{level:g}" if factors == 1 else NAMES.get(name, name + " {:g}").format(level)


@dataclass(frozen=True)
class _Box:
    """What a box shows; of many outliers, the furthest."""

    q1: float
    median: float
    q3: float
    low: float
    high: float
    outliers: Array

    @classmethod
    def of(cls, values: Array) -> _Box:
        q1, median, q3 = (float(q) for q in np.percentile(values, [25, 50, 75]))
        inside = np.abs(values - np.clip(values, q1, q3)) <= 1.5 * (q3 - q1)
        outliers = np.sort(values[~inside])[-MOST_OUTLIERS:]
        return cls(q1, median, q3, float(values[inside].min()), float(values[inside].max()), outliers)


def _boxes(axis: Axes, boxes: list[_Box], at: list[float], width: float, *, label: str) -> None:
    """Boxes of one method as a few artists: matplotlib's own boxplot has ten a box, and takes seconds."""
    colour = COLOURS.get(label, INK)
    q1, median, q3, low, high = np.array([[b.q1, b.median, b.q3, b.low, b.high] for b in boxes]).T
    axis.bar(
        at,
        q3 - q1,
        width,
        bottom=q1,
        color=colour,
        alpha=0.75,
        label="Cramer-Rao bound" if label == BOUND else label,
    )
    axis.vlines(
        np.tile(at, 2), np.concatenate([low, q3]), np.concatenate([q1, high]), color=colour, linewidth=0.9
    )
    left, right = np.array(at) - width / 2, np.array(at) + width / 2
    axis.hlines(median, left, right, color=INK, linewidth=1.3)
    x = np.repeat(at, [len(box.outliers) for box in boxes])
    y = np.concatenate([box.outliers for box in boxes])
    axis.plot(x, y, "x", color=colour, markersize=2.5, markeredgewidth=0.6)


def _draw_curves(axis: Axes, study: Study, rows: list[Row], stage: str, quantity: str) -> None:
    """The statistic over the first factor with its confidence interval, the median below it, the bound dashed."""
    x_name, statistic = next(iter(study.factors)), study.figure.statistic
    chosen = [row for row in rows if row.quantity == quantity and row.stage == stage]
    keys = list(dict.fromkeys((row.method, _rest(row, x_name)) for row in chosen if row.method != BOUND))
    several = len(study.methods) > 1
    for colour, (method, rest) in zip((SERIES * len(keys))[: len(keys)], keys, strict=True):
        own = [row for row in chosen if row.method == method and _rest(row, x_name) == rest]
        x = [row.levels[x_name] for row in own]
        words = [NAMES.get(name, name + " {:g}").format(level) for name, level in rest]
        label = ", ".join([*words, *([method] if several or not words else [])])
        axis.plot(x, [getattr(row, statistic) for row in own], "o-", color=colour, markersize=4, label=label)
        if statistic != "rms":
            low, high = ([getattr(row, f"{statistic}_{end}") for row in own] for end in ("low", "high"))
            axis.fill_between(x, low, np.minimum(high, 1e9), color=colour, alpha=0.2, linewidth=0)
        bound = [row for row in chosen if row.method == BOUND and _rest(row, x_name) == rest]
        if bound and method == study.methods[0]:
            label_of = "Cramer-Rao bound" if colour == SERIES[0] else None
            axis.plot(
                [row.levels[x_name] for row in bound],
                [getattr(row, statistic) for row in bound],
                "--",
                color=colour,
                linewidth=0.9,
                label=label_of,
            )
    if study.answer and study.answer.quantity == quantity:
        axis.axhline(study.answer.goal, color=INK, linewidth=0.8, linestyle=":")
        axis.annotate(
            f"{study.answer.goal:g}",
            (1, study.answer.goal),
            xycoords=("axes fraction", "data"),
            xytext=(2, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
        )
    words_of = {"p95": "95 % of errors are below", "median": "half of errors are below", "rms": "rms"}
    axis.set_title(words_of[statistic])
    axis.set_xlabel(AXES.get(x_name, x_name))
    if study.figure.log:
        axis.set_yscale("log")
        axis.minorticks_off()
    else:
        axis.set_ylim(bottom=0)
    axis.grid(axis="x", color=FAINT, linewidth=0.3)


def _rest(row: Row, x_name: str) -> tuple[tuple[str, float], ...]:
    return tuple((name, level) for name, level in row.levels.items() if name != x_name)
