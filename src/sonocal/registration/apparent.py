"""What rows seem to say of a motion and noise alone gives: errors in variables, and degeneracy against the noise."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, sqrt

import numpy as np

from sonocal import _core
from sonocal.geometry import Array
from sonocal.registration.uncertainty import SIGNIFICANT

__all__ = ["Apparent"]

# The logarithm of a ratio of squared levels that leaves the lesser of them nothing that matters.
MOST_DOUBT = 20.0


@dataclass(frozen=True, eq=False)
class Apparent:
    """Noise is in the derivatives of residuals, too, and their products ``H = J'WJ`` hold its square.

    Of needles in one plane the image points lie on one line; noise moves them off it, and H says that the turn about
    the line is known. What noise gives is known from the levels: `M`. The rest, ``H - M``, is what rows really say.

    Attributes:
        covariance: (k, k), H^-1.
        of_px, of_mm: (k, k), parts of M from image points and from segment ends.
        by_ratio: (k,), derivative of half the cost's gradient by the logarithm of the levels' squares' ratio.
        doubt: standard deviation of that logarithm; 0 where levels are known.
        px_share: part of the residuals' variance that image points have.
    """

    covariance: Array
    of_px: Array
    of_mm: Array
    by_ratio: Array
    doubt: float
    px_share: float

    @classmethod
    def of(cls, sums: _core.NoiseSums, covariance: Array, unit: float) -> Apparent:
        """From the core's sums; `unit`: the residuals' variance, of which the levels say 1."""
        of_px, of_mm = unit * sums.from_noise
        doubt = sqrt(max(sums.ratio_variance, 0.0))
        return cls(covariance, of_px, of_mm, sums.by_ratio, doubt, sums.px_share)

    def corrected(self, covariance: Array) -> Array:
        """The covariance (k, k) of an answer freed of noise's pull, which H^-1 alone states too small.

        The corrected gradient has the variance H at most and the slope H - M, so ``(H - M)^-1 H (H - M)^-1``; and how
        much is corrected depends on the two levels' ratio, of which few rows are unsure.

        Source: Carroll, Ruppert, Stefanski and Crainiceanu, Measurement Error in Nonlinear Models, 2006, chapter 7.
        """
        left = np.eye(len(covariance)) - self.covariance @ (self.of_px + self.of_mm)
        if not self._greatest(1.0, 1.0) < 1:
            return covariance
        widening = np.linalg.inv(left)
        moved = self.doubt * (widening @ self.covariance @ self.by_ratio)
        return np.asarray(widening @ covariance @ widening.T + np.outer(moved, moved))

    def share(self, sightings: int) -> float:
        """Of H in the direction where it is most, the share that noise may have, within three standard deviations.

        Of the levels' ratio, and of a square of so many sightings' noise.
        """
        doubt = min(SIGNIFICANT * self.doubt, MOST_DOUBT)
        greatest = max(self._greatest(*self._factors(by)) for by in {0.0, -doubt, doubt})
        return greatest * (1 + SIGNIFICANT * sqrt(2 / max(sightings, 1)))

    def _greatest(self, px: float, mm: float) -> float:
        shares = np.linalg.eigvals(self.covariance @ (px * self.of_px + mm * self.of_mm))
        return float(shares.real.max())

    def _factors(self, by: float) -> tuple[float, float]:
        """By how much the squares of px and mm change if their ratio does by exp(by) and their sum's does not."""
        px, mm = self.px_share, 1 - self.px_share
        return 1 / (px + mm * exp(-by)), 1 / (px * exp(by) + mm)
