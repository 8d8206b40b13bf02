"""Figures of a study: boxes in the paper's form, or a curve over a factor."""

from __future__ import annotations

import io
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

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

# By method: what is ours is blue, what is linear is orange.
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
LEVELS = {
    "dimension": "{:g}D probe",
    "needles": "{:g} needles",
    "needle_mm": "{:g} mm apart",
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
    "needle_mm": "distance of the tracked points, mm",
    "tilt_deg": "greatest tilt from the image's normal, deg",
    "depth_mm": "depth of the target, mm",
    "sigma_mm": "noise of the needle's ends along each axis, mm",
    "sigma_px": "noise of the image point along each axis, px",
    "latency_ms": "latency of the tracker, ms",
    "outlier_share": "share of outliers",
}
STATISTICS = {"p95": "95 % of errors are below", "median": "half of errors are below", "rms": "rms"}
MOST_OUTLIERS = 60
PANEL_IN = (4.0, 2.9)

Rest = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class _Panel:
    """A quantity; and the levels of the factors after the first, where they have panels of their own."""

    quantity: str
    rest: Rest | None

    def title(self, words: str) -> str:
        return ", ".join([words, *map(_words, self.rest or ())])


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
            "figures need matplotlib, which is not installed; pip install matplotlib"
        ) from None
    study = store.study
    boxes = study.figure.form == "boxes"
    stages = study.figure.stages if boxes else study.figure.stages[-1:]
    panels = list(_panels(study))
    with mpl.rc_context(RC):
        width, height = max(PANEL_IN[0] * len(panels), 5.5), PANEL_IN[1] * len(stages) + 0.75
        figure = Figure(figsize=(width, height))
        grid = figure.subplots(len(stages), len(panels), squeeze=False)
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
            for axis, panel in zip(axes, panels, strict=True):
                if boxes:
                    _draw_boxes(axis, store, stage, panel)
                else:
                    _draw_curves(axis, study, rows, panel)
                _finish_axis(axis, study, panel)
        _draw_legend(figure, grid)
        figure.suptitle(
            study.title, x=0.1 / width, y=1 - 0.1 / height, ha="left", va="top", fontweight="bold"
        )
        content = io.BytesIO()
        figure.savefig(content, dpi=dpi, format="png", metadata={"Software": None})
    return content.getvalue()


def _panels(study: Study) -> Iterator[_Panel]:
    """One a quantity; with several methods to tell apart, one for every level of the factors after the first, too."""
    own = study.figure.form == "boxes" or len(study.methods) > 1
    rests = [_rest_of(cell.levels) for cell in study.cells()] if own else [None]
    yield from itertools.starmap(_Panel, itertools.product(study.figure.quantities, dict.fromkeys(rests)))


def _finish_axis(axis: Axes, study: Study, panel: _Panel) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator

    axis.set_ylabel(QUANTITIES[panel.quantity])
    name = next(iter(study.factors))
    axis.set_xlabel(AXES.get(name, name))
    axis.grid(axis="y")
    axis.set_axisbelow(True)
    if not study.figure.log:
        axis.set_ylim(bottom=0)
        return
    bottom, top = axis.get_ylim()
    axis.set_yscale("log")
    axis.minorticks_off()
    axis.set_ylim(bottom, top)
    if top < 300 * bottom:
        axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _draw_legend(figure: Any, grid: Any) -> None:
    """Every label once, the bound last."""
    found: dict[str, Any] = {}
    for axis in grid.flat:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    labels = sorted(found, key=lambda label: label.startswith("Cramer"))
    figure.legend([found[label] for label in labels], labels, loc="lower center", ncols=min(len(labels), 7))


def _draw_boxes(axis: Axes, store: Store, stage: str, panel: _Panel) -> None:
    """Median, quartiles, whiskers to the last value within 1.5 quartile distances, and outliers, by level."""
    study = store.study
    cells = [(i, cell) for i, cell in enumerate(study.cells()) if _rest_of(cell.levels) == panel.rest]
    methods = [method for method in study.methods if any(method in cell.methods for _, cell in cells)]
    methods += [BOUND] if panel.quantity in ERRORS else []
    width, limits = 0.8 / len(methods), []
    for m, method in enumerate(methods):
        at, boxes = [], []
        for place, (index, cell) in enumerate(cells):
            if method != BOUND and method not in cell.methods:
                continue
            values = errors_of(store, index, method, stage, panel.quantity)
            values = values[np.isfinite(values)]
            if len(values):
                boxes.append(_Box.of(values))
                at.append(place + (m - (len(methods) - 1) / 2) * width)
        if boxes:
            _boxes(axis, boxes, at, 0.85 * width, label=method)
            limits += [(box.q1, box.greatest) for box in boxes]
    axis.set_xticks(range(len(cells)), [f"{next(iter(cell.levels.values())):g}" for _, cell in cells])
    axis.set_xlim(-0.5, len(cells) - 0.5)
    axis.set_title(panel.title(f"{stage} refinement"))
    if study.figure.log and limits:  # how small the least errors are is of no interest
        axis.set_ylim(min(q1 for q1, _ in limits) / 5, 1.3 * max(top for _, top in limits))


@dataclass(frozen=True)
class _Box:
    """What a box shows; of many outliers, the furthest."""

    q1: float
    median: float
    q3: float
    low: float
    high: float
    greatest: float
    outliers: Array

    @classmethod
    def of(cls, values: Array) -> _Box:
        q1, median, q3 = (float(q) for q in np.percentile(values, [25, 50, 75]))
        inside = np.abs(values - np.clip(values, q1, q3)) <= 1.5 * (q3 - q1)
        outliers = np.sort(values[~inside])[-MOST_OUTLIERS:]
        low, high = float(values[inside].min()), float(values[inside].max())
        return cls(q1, median, q3, low, high, float(values.max()), outliers)


def _boxes(axis: Axes, boxes: list[_Box], at: list[float], width: float, *, label: str) -> None:
    """Boxes of one method as a few artists: matplotlib's own boxplot has ten a box, and takes seconds."""
    colour = COLOURS.get(label, INK)
    q1, median, q3, low, high = np.array([[b.q1, b.median, b.q3, b.low, b.high] for b in boxes]).T
    axis.bar(at, q3 - q1, width, bottom=q1, color=colour, alpha=0.75, label=_bound_named(label))
    axis.vlines(
        np.tile(at, 2), np.concatenate([low, q3]), np.concatenate([q1, high]), color=colour, linewidth=0.9
    )
    left, right = np.array(at) - width / 2, np.array(at) + width / 2
    axis.hlines(median, left, right, color=INK, linewidth=1.3)
    x = np.repeat(at, [len(box.outliers) for box in boxes])
    y = np.concatenate([box.outliers for box in boxes])
    axis.plot(x, y, "x", color=colour, markersize=2.5, markeredgewidth=0.6)


def _draw_curves(axis: Axes, study: Study, rows: list[Row], panel: _Panel) -> None:
    """The statistic over the first factor with its confidence interval, and the bound dashed."""
    statistic = study.figure.statistic
    chosen = [row for row in rows if row.quantity == panel.quantity and row.stage == "after"]
    if panel.rest is not None:
        chosen = [row for row in chosen if _rest_of(row.levels) == panel.rest]
    keys = list(dict.fromkeys((row.method, _rest_of(row.levels)) for row in chosen))
    rests = list(dict.fromkeys(rest for _, rest in keys))
    for method, rest in keys:
        own = [row for row in chosen if (row.method, _rest_of(row.levels)) == (method, rest)]
        x, y = [next(iter(row.levels.values())) for row in own], [getattr(row, statistic) for row in own]
        by_rest = panel.rest is None
        colour = SERIES[rests.index(rest) % len(SERIES)] if by_rest else COLOURS.get(method, INK)
        if method == BOUND:
            axis.plot(x, y, "--", color=colour, linewidth=0.9, label=_bound_named(method))
            continue
        words = ", ".join(map(_words, rest)) if by_rest and rest else method
        axis.plot(x, y, "o-", color=colour, markersize=4, label=words)
        if statistic != "rms":
            low, high = ([getattr(row, f"{statistic}_{end}") for row in own] for end in ("low", "high"))
            axis.fill_between(x, low, np.minimum(high, 1e9), color=colour, alpha=0.2, linewidth=0)
    if study.answer and study.answer.quantity == panel.quantity:
        axis.axhline(study.answer.goal, color=INK, linewidth=0.8, linestyle=":")
    axis.set_title(panel.title(STATISTICS[statistic]))
    axis.grid(axis="x", color=FAINT, linewidth=0.3)
    if study.figure.log:
        values = [getattr(row, statistic) for row in chosen]
        axis.set_ylim(min(values) / 1.3, 1.3 * max(value for value in values if np.isfinite(value)))


def _rest_of(levels: dict[str, float]) -> Rest:
    """Levels of the factors after the first."""
    return tuple(levels.items())[1:]


def _words(level: tuple[str, float]) -> str:
    name, value = level
    return LEVELS.get(name, name + " {:g}").format(value)


def _bound_named(label: str) -> str:
    return "Cramer-Rao bound" if label == BOUND else label
