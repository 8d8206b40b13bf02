"""The time line of a long recording of tools: a figure, and the page that holds it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sonocal.errors import UnsupportedError, require
from sonocal.report.style import FAINT, FITTED, HELD_OUT, INK, OUTLIER, RC
from sonocal.report.svg import figure_svg
from sonocal.report.templates import filled, now
from sonocal.tools import ToolSession

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_tool_session", "tool_session_html"]

COLOURS = {"pivot": FITTED, "spin": HELD_OUT, "touch": INK, "still": FAINT}
WIDTH, ROW, REST = 7.4, 0.45, 1.1


def plot_tool_session(axis: Axes, session: ToolSession) -> None:
    """A row for each tool, a bar for each stretch; a thin line where the tool was seen and moved.

    Args:
        axis: to draw on.
        session: what was found.
    """
    require("session", session, ToolSession)
    names, shown = list(session.seen), set()
    for row, name in enumerate(names):
        seen = session.times_s[session.seen[name].astype(bool)]
        axis.plot(seen, [row] * len(seen), "|", color=OUTLIER, markersize=3, zorder=1)
    for one in session.stretches:
        start = float(session.times_s[one.first])
        label = None if one.kind in shown else one.kind
        shown.add(one.kind)
        axis.barh(
            names.index(one.tool),
            one.end_s - one.start_s,
            left=start,
            height=0.6,
            color=COLOURS[one.kind],
            label=label,
            zorder=2,
        )
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.set_xlabel("s")
    axis.set_title("What each tool did")
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4)


def tool_session_html(session: ToolSession, rows: Sequence[tuple[str, ...]]) -> bytes:
    """The page of a session, as the content of an HTML file.

    Args:
        session: what was found.
        rows: of its table: the tool, what it did, from when to when, what that told.

    Raises:
        UnsupportedError: matplotlib or jinja2 is not installed.
    """
    require("session", session, ToolSession)
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise UnsupportedError(
            f"the page needs {error.name}, which is not installed; pip install matplotlib jinja2, or leave out --page"
        ) from None
    size = (WIDTH, REST + ROW * len(session.seen))
    with mpl.rc_context(RC):
        figure = figure_svg("session", size, lambda axis: plot_tool_session(axis, session))
    return filled(
        "tool_session.html",
        made=now(),
        name=session.name,
        rows=rows,
        findings=session.diagnostics,
        figure=figure,
    )
