"""A needle that is no straight line: bent by its weight, by the hand or by tissue."""

from __future__ import annotations

import numpy as np

from sonocal.calibration.area import corner_of
from sonocal.calibration.forms import beyond_predicted, can_be_tested, moved_by
from sonocal.calibration.groupings import Groupings
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, area_places
from sonocal.registration.bent_lines import Bend, bend_of
from sonocal.registration.fit import Fit
from sonocal.registration.mapped import MappedRows
from sonocal.registration.noise import Noise

__all__ = ["likeliest_of_needle"]

# One test: two of a thousand sound scans are beyond, and few of these move the answer.
SURE = 0.002
# Of the places along the segments: between these the needle was seen.
SEEN = (0.05, 0.95)


def likeliest_of_needle(
    mapped: MappedRows, fit: Fit, noise: Noise, groupings: Groupings, area: tuple[Array, str]
) -> tuple[float, Diagnostic] | None:
    """The bend, where it is no chance and moves the answer by more than is predicted.

    Args:
        mapped: the fitted rows under the transform, outliers included.
        fit: the transform.
        noise: of the rows.
        groupings: what rows may share an error by.
        area: (2, d), the image or what was seen of it, and what messages call it.

    Returns:
        How often chance does as much, and the finding.
    """
    area_px, area_name = area
    if not can_be_tested(fit, noise):
        return None
    found = bend_of(
        mapped,
        fit.inlier,
        levels=(noise.sigma_px or 0.0, noise.sigma_mm or 0.0),
        parameters=len(fit.covariance),
        groups=list(groupings.labels.values()),
    )
    if found is None or found.p_value > SURE:
        return None
    corners = area_places(area_px)[:-1]
    moved = np.linalg.norm(moved_by(fit, found.moved, corners), axis=1)
    if (beyond := beyond_predicted(moved, fit, noise, corners)) is None:
        return None
    return found.p_value, _finding(found, _bend_mm(found, mapped, fit), *beyond, area_name)


def _bend_mm(found: Bend, mapped: MappedRows, fit: Fit) -> float:
    """How much more the needle is off at one end of the part that was seen than at the other."""
    place = (mapped.along_mm / mapped.lengths_mm)[fit.inlier]
    low, high = np.quantile(place, SEEN)
    return float(np.linalg.norm(found.sag_mm) * (high - low))


def _finding(found: Bend, bend_mm: float, moved_mm: float, bound_mm: float, area_name: str) -> Diagnostic:
    return Diagnostic(
        code="bent-needle",
        severity="warning",
        message=(
            f"residuals follow the place along the needle, by some {bend_mm:.1f} mm over the part that was seen and "
            "one way as the probe sees it, as where it is bent (by chance once in "
            f"{1 / max(found.p_value, 1e-6):.0f} scans); undone, this would move the answer by up to {moved_mm:.1f} mm "
            f"at {corner_of(area_name)}, where an error of {bound_mm:.1f} mm (95 %) is predicted"
        ),
        advice=(
            "look along the needle; take a stiffer or a shorter one, hold it without load, turn it about its axis "
            "during the scan, and check both ends of its segment"
        ),
    )
