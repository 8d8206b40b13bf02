"""What to trust, on one page: a self-contained HTML file and its figures. Needs matplotlib and jinja2.

Each figure is drawn on a matplotlib axis that the caller made: ``plot_predicted_error(axis, calibration)``. What a
session asks of a calibration itself (``calibration.plot()``) is in `sonocal.report.session`.
"""

from sonocal.report.checks import checks_html, plot_checks
from sonocal.report.figures import (
    plot_predicted_error,
    plot_residuals_by_frame,
    plot_residuals_over_image,
    plot_tilts,
)
from sonocal.report.labels import plot_labels
from sonocal.report.page import report_html
from sonocal.report.pictures import FrameImage, plot_frame
from sonocal.report.places import plot_place
from sonocal.report.session import Report
from sonocal.report.tool_sessions import plot_tool_session, tool_session_html
from sonocal.report.views3d import plot_frames, plot_matrix, plot_needles, plot_weak_motion

__all__ = [
    "FrameImage",
    "Report",
    "checks_html",
    "plot_checks",
    "plot_frame",
    "plot_frames",
    "plot_labels",
    "plot_matrix",
    "plot_needles",
    "plot_place",
    "plot_predicted_error",
    "plot_residuals_by_frame",
    "plot_residuals_over_image",
    "plot_tilts",
    "plot_tool_session",
    "plot_weak_motion",
    "report_html",
    "tool_session_html",
]
