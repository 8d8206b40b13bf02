"""What a user knows of correspondences beyond their places: how sure each is; and of scales that are known."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array, real_array
from sonocal.registration.constraints import Rows
from sonocal.registration.options import positive_number

__all__ = ["Told", "scale_of", "sigmas_of", "weights_of"]

# Of two deviations: a correspondence that is surer than another by more than this leaves the other without any say.
MOST_RATIO = 1e6
# A micrometre against the Earth, and the other way round.
LARGEST_SCALE = 1e15


@dataclass(frozen=True, eq=False)
class Told:
    """Known of the correspondences.

    Attributes:
        weights: (C,), above 0 and up to 1: what least squares multiplies distances by; None: all alike.
    """

    weights: Array | None = None

    def of_rows(self, rows: Rows, chosen: NDArray[np.bool_]) -> Array | None:
        """(N,): the weights of the chosen correspondences' rows."""
        if self.weights is None:
            return None
        return np.repeat(self.weights[chosen], np.diff(rows.first)[chosen])


def sigmas_of(sigma_mm: float | ArrayLike | None) -> Array | None:
    """Deviations of each correspondence; None where there is none, or one for all.

    Raises:
        InputError: they are no numbers.
    """
    if sigma_mm is None or isinstance(sigma_mm, (Real, str)):
        return None
    sigmas = real_array("sigma_mm", sigma_mm)
    return sigmas if sigmas.ndim else None


def scale_of(value: float | Array) -> float:
    """A scale that is known, also as another transform has it.

    Raises:
        InputError: it is no positive number, or of no two things that one could see.
    """
    plain = value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value
    scale = positive_number("scale", plain)
    if not 1 / LARGEST_SCALE <= scale <= LARGEST_SCALE:
        raise InputError(
            f"scale is {scale:.3g}; give one between {1 / LARGEST_SCALE:g} and {LARGEST_SCALE:g}"
        )
    return scale


def weights_of(sigma_mm: ArrayLike, count: int) -> Array:
    """Weights of so many correspondences from the deviations of their distances, mm.

    Raises:
        InputError: there are not as many, one is not positive, or they are too far apart.
    """
    sigma = real_array("sigma_mm", sigma_mm)
    if sigma.shape != (count,):
        raise InputError(
            f"sigma_mm must be a number, or one for each of the {count} correspondences; got shape {sigma.shape}"
        )
    if not (np.all(np.isfinite(sigma)) and np.all(sigma > 0)):
        row = int(np.flatnonzero(~(np.isfinite(sigma) & (sigma > 0)))[0])
        raise InputError(
            f"sigma_mm of correspondence {row} is {sigma[row]:g} and not positive; give a deviation in mm"
        )
    if sigma.max() > MOST_RATIO * sigma.min():
        raise InputError(
            f"sigma_mm is from {sigma.min():g} to {sigma.max():g}, a ratio beyond {MOST_RATIO:g}; leave out what is so "
            "unsure"
        )
    return np.ascontiguousarray(sigma.min() / sigma)
