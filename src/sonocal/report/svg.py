"""Figures as SVG, to stand within a page."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import Any

from sonocal.calibration import Calibration
from sonocal.errors import UnsupportedError
from sonocal.geometry import Array, AxisScaled, Similarity
from sonocal.report import views3d
from sonocal.report.style import ON_PAGE, RC

__all__ = ["figure_svg", "matrix_svg"]


def matrix_svg(
    probe_from_image: AxisScaled | Similarity, area_px: Array, ours: Calibration | None = None
) -> str:
    """Where a matrix puts an area of the image (2, d), and ours.

    Raises:
        UnsupportedError: matplotlib is not installed.
    """
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise UnsupportedError(
            f"the report needs {error.name}, which is not installed; pip install matplotlib jinja2, or --no-report"
        ) from None
    with mpl.rc_context(RC):
        return figure_svg(
            "matrix", (4.6, 4.2), lambda a: views3d.plot_matrix(a, probe_from_image, area_px, ours), "3d"
        )


def figure_svg(
    name: str, size: tuple[float, float], draw: Callable[[Any], None], projection: str | None = None
) -> str:
    """A figure as an SVG element whose ids are its own in the page."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    # Fixed margins: the automatic layout draws everything twice.
    width, height = size
    left, bottom = (0.08 * width, 0.08 * height) if projection else (0.6, 0.45)
    # The names of a polar axis's directions stand between it and its title.
    top = 0.7 if projection == "polar" else 0.35
    figure = Figure(figsize=size)
    FigureCanvasSVG(figure)
    box = (left / width, bottom / height, 1 - (left + 0.15) / width, 1 - (bottom + top) / height)
    draw(figure.add_axes(box, projection=projection))
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    for before in (' id="', "url(#", 'xlink:href="#', ' href="#'):
        text = text.replace(before, f"{before}{name}-")
    for colour, variable in ON_PAGE.items():
        text = text.replace(colour, variable)
    return text.replace("<svg", '<svg role="img"', 1)
