"""Two calibrations against one another: where in the image, by how many mm, and more than they allow?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration
from sonocal.errors import InputError, UnsupportedError, require
from sonocal.geometry import Array, area_places
from sonocal.registration.uncertainty import point_covariance, radius_95

__all__ = ["Comparison", "compare"]


# Below it no number of a test means anything.
LEAST_P = 1e-4


@dataclass(frozen=True, eq=False)
class Comparison:
    """How far apart two calibrations put the image.

    Attributes:
        places_px: (M, d): corners, then centre, of the first calibration's image area.
        difference_mm: (M, 3), second minus first, in the probe marker's frame.
        distance_mm: (M,), its length.
        allowed_mm: (M,): what 95 % of such distances stay below if both are right within their uncertainty.
        p_value: how often right calibrations would differ by as much, taken over all places at once.
        shared_input: both were fitted to the same rows, so that their errors go together and the p-value is
            too large.
    """

    places_px: Array
    difference_mm: Array
    distance_mm: Array
    allowed_mm: Array
    p_value: float
    shared_input: bool

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """(M,): whether the distance is more than their uncertainty allows."""
        return self.distance_mm > self.allowed_mm

    @property
    def rows(self) -> list[tuple[str, float, float]]:
        """A place in words, the distance and the allowed distance there, for tables."""
        return [
            (", ".join(f"{x:.0f}" for x in place), float(distance), float(allowed))
            for place, distance, allowed in zip(
                self.places_px, self.distance_mm, self.allowed_mm, strict=True
            )
        ]

    @property
    def differ(self) -> bool:
        """Whether they differ by more than their uncertainty, at the 5 % level."""
        return self.p_value < 0.05

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        worst = int(np.argmax(self.distance_mm))
        at = ", ".join(f"{x:.0f}" for x in self.places_px[worst])
        verdict = (
            "over the whole image more than their uncertainty explains"
            if self.differ
            else "over the whole image no more than their uncertainty explains"
        )
        distance = f"{self.distance_mm[worst]:.2f} mm, at ({at}) px"
        return f"They differ by up to {distance}: {verdict} ({_p(self.p_value)})."


def _p(value: float) -> str:
    return f"p = {value:.2g}" if value >= LEAST_P else f"p < {LEAST_P:g}"


def compare(first: Calibration, second: Calibration) -> Comparison:
    """Compare two calibrations of one probe and marker.

    Raises:
        InputError: one is of a 2D and the other of a 3D probe.
        UnsupportedError: one has no covariance.

    Source: Wald's test of the difference of the mapped places; errors of the two taken as independent.
    """
    from scipy.special import gammaincc

    for one in (first, second):
        require(one, Calibration, "a calibration (see load)")
    if first.dimension != second.dimension:
        raise InputError(
            f"the calibrations are of a {first.dimension}D and of a {second.dimension}D probe; compare two of one probe"
        )
    if first.covariance is None or second.covariance is None:
        raise UnsupportedError("a calibration without covariance has no uncertainty to compare with")
    places = area_places(first.area_px)
    difference = second.probe_from_image @ places - first.probe_from_image @ places
    covariances = sum(
        point_covariance(c.probe_from_image, c.covariance, places)
        for c in (first, second)
        if c.covariance is not None
    )
    statistic, freedom = _wald(first, second, places, difference)
    return Comparison(
        places_px=places,
        difference_mm=difference,
        distance_mm=np.linalg.norm(difference, axis=1),
        allowed_mm=radius_95(np.asarray(covariances)),
        p_value=float(gammaincc(freedom / 2.0, statistic / 2.0)),
        shared_input=_fitted_to(first) == _fitted_to(second),
    )


def _fitted_to(calibration: Calibration) -> tuple[object, ...]:
    options = calibration.options
    return (calibration.provenance.get("sha256"), options.fit_split, options.test_split, calibration.fit)


def _wald(first: Calibration, second: Calibration, places: Array, difference: Array) -> tuple[float, int]:
    """Chi-squared statistic and freedom of all places' differences at once."""
    from sonocal.registration.uncertainty import point_jacobian

    total = np.zeros((difference.size, difference.size))
    for calibration in (first, second):
        assert calibration.covariance is not None
        k = len(calibration.covariance)
        stacked = point_jacobian(calibration.probe_from_image, places, k).reshape(-1, k)
        total += stacked @ calibration.covariance @ stacked.T
    values, vectors = np.linalg.eigh(total)
    # Mapped places have as many free motions as the calibration has parameters; the rest is rounding.
    kept = values > 1e-9 * values[-1]
    along = vectors[:, kept].T @ difference.reshape(-1)
    return float(np.sum(along**2 / values[kept])), int(kept.sum())
