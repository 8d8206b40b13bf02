"""What a session, such as a notebook, asks of a calibration itself: a room above draws it.

The one arrow upwards of the house, and by name: whoever calibrates imports nothing that draws. `UPWARDS` in
scripts/check_imports.py has it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from sonocal.observations import Observations

__all__ = ["InSession"]

DRAWS = "sonocal.report.session"


class InSession:
    """The methods of a calibration by which a session shows it."""

    def _repr_html_(self) -> str:
        html: str = import_module(DRAWS).calibration_card(self)
        return html

    def report(self, observations: Observations | None = None) -> Any:
        """The page that `sonocal calibrate` writes: a notebook shows it, ``report().save("report.html")`` keeps it.

        Args:
            observations: the rows that were calibrated on; without them there are no figures of residuals.

        Returns:
            A `sonocal.report.Report`.

        Raises:
            InputError: the observations are none.
            UnsupportedError: matplotlib or Jinja2 is not installed.
        """
        return import_module(DRAWS).report(self, observations)

    def plot(
        self,
        what: str = "predicted_error",
        observations: Observations | None = None,
        *,
        axis: Axes | None = None,
    ) -> Axes:
        """Draw a figure, on an axis of its own where none is given.

        Args:
            what: "predicted_error", "frames" or "weak_motion"; of the rows that were calibrated on,
                "residuals_over_image", "residuals_by_frame", "tilts" or "needles".
            observations: those rows; over the predicted error they are dots.
            axis: of matplotlib: for "tilts" a polar one, for "frames", "needles" and "weak_motion" one in 3D.

        Returns:
            The axis.

        Raises:
            InputError: there is no such figure, or it is of the rows and none were given.
            UnsupportedError: matplotlib is not installed, or the figure needs a covariance that there is not.
        """
        drawn: Axes = import_module(DRAWS).plot(self, what, observations, axis)
        return drawn
