"""Checks of a calibration over months: a figure, and the page that holds it."""

from __future__ import annotations

import datetime
import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from sonocal.errors import InputError, UnsupportedError, require
from sonocal.report.style import FAINT, FITTED, HELD_OUT, INK, OUTLIER, RC
from sonocal.report.svg import figure_svg
from sonocal.report.templates import filled, now
from sonocal.validation.check_log import CheckLog, CheckRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["checks_html", "plot_checks"]

# Colour, mark and words of each verdict: told apart in grey, too.
MARKS = {
    "holds": (FITTED, "o", "holds"),
    "changed": (HELD_OUT, "X", "changed"),
    "cannot tell": (OUTLIER, "s", "cannot tell"),
}
SIZE = (7.4, 3.4)


def plot_checks(axis: Axes, checks: Sequence[CheckRecord]) -> None:
    """How far each check found the image moved, over time; a bar goes up to what it would have seen whichever way.

    Args:
        axis: to draw on.
        checks: of a log, one or more.

    Raises:
        InputError: there is no check.
    """
    require("checks", checks, Sequence, "the checks of a log")
    if not checks:
        raise InputError("checks must hold one check or more to be drawn; got none")
    dates: Any = importlib.import_module("matplotlib.dates")  # its own types say nothing
    times = [float(dates.date2num(datetime.datetime.fromisoformat(one.checked))) for one in checks]
    for time, one in zip(times, checks, strict=True):
        if one.visible_mm is not None:
            axis.plot(
                [time, time], [0, one.visible_mm], color=FAINT, linewidth=3, solid_capstyle="butt", zorder=1
            )
    for verdict, (colour, mark, words) in MARKS.items():
        chosen = [(t, one.moved_mm) for t, one in zip(times, checks, strict=True) if one.verdict == verdict]
        if chosen:
            axis.plot(*zip(*chosen, strict=True), mark, color=colour, label=words, markersize=6, zorder=3)
    tolerance = checks[-1].tolerance_mm
    axis.axhline(tolerance, color=INK, linewidth=0.8, linestyle="--", zorder=2)
    axis.annotate(
        f"{tolerance:g} mm matter", (0.01, tolerance), xycoords=("axes fraction", "data"), va="bottom"
    )
    locator = dates.AutoDateLocator(minticks=2, maxticks=7)
    axis.xaxis.set_major_locator(locator)
    axis.xaxis.set_major_formatter(dates.ConciseDateFormatter(locator))
    if len(set(times)) == 1:
        axis.set_xlim(times[0] - 1.0, times[0] + 1.0)
    axis.set_ylim(0, 1.25 * max(tolerance, *(one.moved_mm for one in checks)))
    axis.set_ylabel("moved, mm rms over the image")
    axis.set_title("Checks of the calibration (grey: what would have been seen whichever way)")
    axis.legend(loc="upper right", ncols=3)


def checks_html(log: CheckLog) -> bytes:
    """The page of a log of checks, as the content of an HTML file.

    Raises:
        UnsupportedError: matplotlib or jinja2 is not installed.
    """
    require("log", log, CheckLog)
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise UnsupportedError(
            f"the report needs {error.name}, which is not installed; pip install matplotlib jinja2, or --no-report"
        ) from None
    with mpl.rc_context(RC):
        figure = figure_svg("checks", SIZE, lambda axis: plot_checks(axis, log.checks))
    return filled(
        "checks.html", made=now(), name=log.name, last=log.checks[-1], checks=log.checks[::-1],
        damaged=log.damaged, figure=figure,
    )  # fmt: skip
