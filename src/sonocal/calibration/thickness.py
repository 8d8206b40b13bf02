"""A slice of some thickness shows a slanted needle's first echo too high: the error leans with the needle."""

from __future__ import annotations

import numpy as np

from sonocal.calibration.area import corner_of
from sonocal.calibration.forms import beyond_predicted, can_be_tested, moved_by
from sonocal.calibration.groupings import Groupings
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, area_places
from sonocal.registration.fit import Fit
from sonocal.registration.image_distortion import Distortion, likeliest_distortion, side_by_side
from sonocal.registration.mapped import MappedRows
from sonocal.registration.noise import Noise
from sonocal.registration.uncertainty import NORMAL_95

__all__ = ["likeliest_of_slice"]

# Of two forms that nearly agree: one is beyond this in one or two of a thousand sound scans.
SURE = 0.001
# Tangents of a needle's lean: one that lies nearly in the image is no point in it.
MOST_LEAN = 3.0


def first_echoes(mapped: MappedRows) -> dict[str, Array]:
    """How far a slice of 1 mm moves the first echo of each needle.

    Where a needle leans by the tangent t out of across the image, a slice of thickness h shows a streak from -h t / 2
    to h t / 2, of which the shallower end comes first.

    Args:
        mapped: the fitted rows of a 2D image under the transform.

    Returns:
        By name: (N, 3), px: where the streak's end lies, and its depth alone, as where beams keep to their column.
    """
    turned = mapped.directions @ mapped.transform.rotation
    lean = turned[:, :2] / np.where(turned[:, 2:] == 0, np.finfo(float).tiny, turned[:, 2:])
    lean = np.clip(lean, -MOST_LEAN, MOST_LEAN)
    half_px = 0.5 * lean / mapped.transform.scales[:2]
    end = -np.sign(half_px[:, 1:]) * half_px
    flat = np.zeros((len(end), 1))
    return {"end": np.hstack([end, flat]), "depth": np.hstack([flat, end[:, 1:], flat])}


def likeliest_of_slice(
    mapped: MappedRows, fit: Fit, noise: Noise, groupings: Groupings, area: tuple[Array, str]
) -> tuple[float, Diagnostic] | None:
    """A slice's thickness, where it is no chance and moves the answer by more than is predicted.

    Args:
        mapped: the fitted rows under the transform, outliers included.
        fit: the transform.
        noise: of the rows.
        groupings: what rows may share an error by.
        area: (2, d), the image or what was seen of it, and what messages call it.

    Returns:
        How often chance does as much, and the finding; None of a volume.
    """
    area_px, area_name = area
    if mapped.table.dimension == 3 or not can_be_tested(fit, noise):
        return None
    echoes = first_echoes(mapped)
    chosen = {name: echo[side_by_side(mapped, fit.inlier)] for name, echo in echoes.items()}
    found = likeliest_distortion(
        mapped,
        fit.inlier,
        echoes,
        levels=(noise.sigma_px or 0.0, noise.sigma_mm or 0.0),
        parameters=len(fit.covariance),
        groups=list(groupings.labels.values()),
        forms_at=lambda _: chosen,  # they lean with the needle, wherever it is seen
    )
    # A slice that is thinner than nothing is something else.
    if found is None or found.p_value > SURE or found.size < 0:
        return None
    corners = area_places(area_px)[:-1]
    moved = np.linalg.norm(moved_by(fit, found.moved, corners), axis=1)
    if (beyond := beyond_predicted(moved, fit, noise, corners)) is None:
        return None
    return found.p_value, _finding(found, *beyond, area_name)


def _finding(found: Distortion, moved_mm: float, bound_mm: float, area_name: str) -> Diagnostic:
    return Diagnostic(
        code="slice-thickness",
        severity="warning",
        message=(
            f"points lie the shallower the more the needle leans, as the first echoes of a slice {found.size:.1f} mm "
            f"(+-{NORMAL_95 * found.deviation:.1f} mm) thick (by chance once in {1 / max(found.p_value, 1e-6):.0f} "
            f"scans); undone, this would move the answer by up to {moved_mm:.1f} mm at {corner_of(area_name)}, where "
            f"an error of {bound_mm:.1f} mm (95 %) is predicted"
        ),
        advice=(
            "take the middle of the streak that a slanted needle leaves (--centre mass), or scan with needles nearly "
            "at right angles to the image and at the depth of the focus, where the slice is thinnest"
        ),
    )
