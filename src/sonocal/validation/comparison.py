"""Two calibrations against one another: where in the image, by how many mm, and more than they allow?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration
from sonocal.errors import InputError, UnsupportedError, require
from sonocal.geometry import Array, area_places
from sonocal.geometry.shown import brief
from sonocal.registration.uncertainty import point_covariance, point_jacobian, radius_95

__all__ = ["Comparison", "MotionBetween", "compare", "motion_between"]


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

    __repr__ = brief

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

    Source: Hotelling's test of the difference of the two, whose errors are taken as independent, with the freedom that
    both covariances have: few sightings leave their size unsure.
    """
    require("first", first, Calibration)
    require("second", second, Calibration)
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
    # Each has a tangent of its own: which of the two is asked must not matter.
    ways = [motion_between(first, second), motion_between(second, first)]
    return Comparison(
        places_px=places,
        difference_mm=difference,
        distance_mm=np.linalg.norm(difference, axis=1),
        allowed_mm=radius_95(np.asarray(covariances), min(one.freedom for one in ways)),
        p_value=max(one.p_value for one in ways),
        shared_input=_fitted_to(first) == _fitted_to(second),
    )


def _fitted_to(calibration: Calibration) -> tuple[object, ...]:
    options = calibration.options
    return (calibration.provenance.get("sha256"), options.fit_split, options.test_split, calibration.fit)


@dataclass(frozen=True, eq=False)
class MotionBetween:
    """What carries one calibration to another, as a motion of the first.

    Attributes:
        tangent: (k,): rotation vector (rad), translation (mm), log scale.
        covariance: (k, k): of it, where the two are sound and of one truth.
        freedom: residuals to spare that the covariance rests on.
    """

    tangent: Array
    covariance: Array
    freedom: float

    __repr__ = brief

    @property
    def p_value(self) -> float:
        """How often two sound calibrations of one truth would differ by as much, in all numbers at once."""
        from scipy.special import fdtrc

        count = len(self.tangent)
        statistic = float(self.tangent @ np.linalg.solve(self.covariance, self.tangent)) / count
        return float(fdtrc(count, self.freedom, statistic))


def motion_between(first: Calibration, second: Calibration) -> MotionBetween:
    """The motion of the first calibration that comes nearest to the second; both have a covariance."""
    places = area_places(first.area_px)
    difference = second.probe_from_image @ places - first.probe_from_image @ places
    parts = _covariances(first, second, places)
    freedom = _freedom(parts, (first.noise.freedom, second.noise.freedom))
    way = _tangent(first, places, len(parts[0])) @ difference.reshape(-1)
    return MotionBetween(way, parts[0] + parts[1], freedom)


def _tangent(calibration: Calibration, places: Array, parameters: int) -> Array:
    """(k, 3 M): from displacements of the places to the motion of the calibration that comes nearest to them."""
    jacobian = point_jacobian(calibration.probe_from_image, places, parameters)
    return np.asarray(np.linalg.pinv(jacobian.reshape(-1, parameters)))


def _covariances(first: Calibration, second: Calibration, places: Array) -> tuple[Array, Array]:
    """(k, k) of both, as motions of the first: each has a tangent of its own, in which it may have fewer scales."""
    assert first.covariance is not None
    assert second.covariance is not None
    parameters = max(len(first.covariance), len(second.covariance))
    back = _tangent(first, places, parameters)
    carried = []
    for calibration, covariance in ((first, first.covariance), (second, second.covariance)):
        own = point_jacobian(calibration.probe_from_image, places, len(covariance))
        way = back @ own.reshape(-1, len(covariance))
        carried.append(way @ covariance @ way.T)
    return carried[0], carried[1]


def _freedom(parts: tuple[Array, Array], freedoms: tuple[int, int]) -> float:
    """Of the sum of two covariances of unlike certainty: as sure, on average over all motions, as so many residuals.

    1 / f = sum_i (tr(V_i)^2 + 2 tr(V_i^2)) / (k (k + 2) f_i)        V_i = (C_1 + C_2)^-1 C_i

    which is the variance of l' (s_1 C_1 + s_2 C_2) l for s_i ~ chi2(f_i) / f_i, averaged over directions l.

    Source: Satterthwaite 1946; several parameters: Nel and van der Merwe 1986.
    """
    k, total = len(parts[0]), parts[0] + parts[1]
    inverse = 0.0
    for part, freedom in zip(parts, freedoms, strict=True):
        share = np.linalg.solve(total, part)
        inverse += (np.trace(share) ** 2 + 2 * np.trace(share @ share)) / (k * (k + 2) * max(freedom, 1))
    return float(1.0 / inverse)
