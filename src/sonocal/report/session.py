"""What a session, such as a notebook, shows of a calibration: its card, its report, figures on axes of their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sonocal.calibration import Calibration, seen_at_assumed_speed
from sonocal.errors import InputError, UnsupportedError, require
from sonocal.files import path_of, write_atomically
from sonocal.geometry.cards import card, heat_svg, matrix_html
from sonocal.observations import Observations
from sonocal.registration.uncertainty import radius_95
from sonocal.report import figures, views3d
from sonocal.report.page import report_html
from sonocal.validation import give_verdict, validate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["FIGURES", "Report", "calibration_card", "plot", "report"]

# Figures by name: what draws them, on which kind of axis, and whether they are of the rows.
FIGURES: dict[str, tuple[Callable[..., None], str | None, bool]] = {
    "predicted_error": (figures.plot_predicted_error, None, False),
    "residuals_over_image": (figures.plot_residuals_over_image, None, True),
    "residuals_by_frame": (figures.plot_residuals_by_frame, None, True),
    "tilts": (figures.plot_tilts, "polar", True),
    "frames": (views3d.plot_frames, "3d", False),
    "needles": (views3d.plot_needles, "3d", True),
    "weak_motion": (views3d.plot_weak_motion, "3d", False),
}
COLUMNS, ROWS = 12, 9
MOST_REASONS = 3
MATRIX = "probe_from_image (PLUS: ImageToProbe), mm from px"


@dataclass(frozen=True, eq=False)
class Report:
    """The page of a calibration: a notebook shows it, `save` keeps it.

    Attributes:
        content: of the HTML file.
    """

    content: bytes

    def __repr__(self) -> str:
        return f'<Report of {len(self.content) / 1e3:.0f} kB: save("report.html") keeps it, to open in a browser>'

    def _repr_html_(self) -> str:
        page = escape(self.content.decode())
        return (
            f'<iframe srcdoc="{page}" sandbox="" title="Report of a calibration" '
            'style="width:100%;height:40em;border:1px solid rgba(128,128,128,.45);background:white"></iframe>'
        )

    def save(self, path: str | Path) -> Path:
        """Write the page, whole or not at all; a file of that name is replaced.

        Returns:
            The path.

        Raises:
            InputError: the file cannot be written.
        """
        write_atomically(path, self.content)
        return path_of(path)


def report(calibration: Calibration, observations: Observations | None = None) -> Report:
    """The report of a calibration, as `sonocal calibrate` writes it.

    Raises:
        InputError: the observations are none.
        UnsupportedError: matplotlib or Jinja2 is not installed.
    """
    if observations is None:
        return Report(report_html(calibration))
    require("observations", observations, Observations)
    return Report(report_html(calibration, observations, validate(calibration, observations, resample=False)))


def plot(
    calibration: Calibration,
    what: str = "predicted_error",
    observations: Observations | None = None,
    axis: Axes | None = None,
) -> Axes:
    """Draw a figure of a calibration.

    Raises:
        InputError: there is no such figure, or it is of the rows and none were given.
        UnsupportedError: matplotlib is not installed, or the figure needs a covariance that there is not.
    """
    if what not in FIGURES:
        raise InputError(f"what must be one of {', '.join(FIGURES)}; got {what!r}"[:300])
    draw, projection, of_rows = FIGURES[what]
    if observations is not None:
        require("observations", observations, Observations)
        observations = seen_at_assumed_speed(calibration.sound, observations)
    elif of_rows:
        raise InputError(
            f"observations must be given for {what!r}: the table of sightings that was calibrated on"
        )
    if axis is not None and not hasattr(axis, "set_title"):
        raise InputError(f"axis must be an axis of matplotlib, or None for a new one; got {axis!r}"[:200])
    axis = _new_axis(projection) if axis is None else axis
    takes_rows = of_rows or what == "predicted_error"
    draw(axis, calibration, *([observations] if takes_rows and observations is not None else []))
    return axis


def _new_axis(projection: str | None) -> Axes:
    try:
        from matplotlib import pyplot as plt
    except ImportError as error:
        raise UnsupportedError(
            f"a figure needs {error.name}, which is not installed; pip install matplotlib"
        ) from None
    return plt.figure(layout="constrained").add_subplot(projection=projection)


def calibration_card(calibration: Calibration) -> str:
    """The verdict with its reasons, the numbers, and the predicted error over the image."""
    verdict = give_verdict(calibration)
    scales = calibration.scales_mm_per_px
    rows = [
        ("scale", f"{' x '.join(f'{s:.5g}' for s in scales)} mm/px"),
        ("rows that agree", f"{calibration.fit.inliers} of {calibration.fit.observations}"),
        ("their distances", f"{calibration.fit.rms_mm:.2f} mm rms"),
    ]
    if calibration.test is not None:
        rows.append(("held out", f"{calibration.test.rms_mm:.2f} mm rms"))
    rows += list(zip(verdict.codes, verdict.reasons, strict=True))[:MOST_REASONS]
    if further := len(verdict.reasons) - MOST_REASONS:
        rows += [("", f"and {further} more: diagnostics has all")] * (further > 0)
    return card(
        verdict.headline,
        verdict.expectation,
        rows,
        picture=_thumbnail(calibration),
        below=matrix_html(MATRIX, calibration.probe_from_image.matrix),
        tone=verdict.level,
    )


def _thumbnail(calibration: Calibration) -> str:
    """The error that 95 % stay below over the image, of a volume over its middle slice; nothing where none is known."""
    if calibration.covariance is None:
        return ""
    low, high = calibration.area_px
    u, v = ((np.arange(n) + 0.5) / n * (high[i] - low[i]) + low[i] for i, n in enumerate((COLUMNS, ROWS)))
    places: Any = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    if calibration.dimension == 3:
        places = np.column_stack([places, np.full(len(places), (low[2] + high[2]) / 2)])
    below = radius_95(calibration.predict(places)[1], calibration.noise.freedom).reshape(ROWS, COLUMNS)
    seen = None if calibration.seen_px is None else calibration.seen_px[:, :2]
    says = f"Predicted error (95 %) over the {calibration.area_name}; dashed: where the needle was seen"
    corners = calibration.predicted_errors()[2]
    label = f"{min(below.min(), corners[-1]):.1f} to {corners.max():.1f} mm (95 %)"
    return heat_svg(calibration.area_px[:, :2], below, label, says, seen)
