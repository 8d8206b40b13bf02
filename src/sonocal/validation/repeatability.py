"""How far apart repeated calibrations are: the field's calibration reproducibility."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration
from sonocal.calibration.held_out import independent_units
from sonocal.calibration.statistics import log_interval
from sonocal.errors import UnsupportedError
from sonocal.geometry import Array, area_places
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.registration.options import unknowns
from sonocal.validation.held_out import refitted
from sonocal.validation.quantity import Quantity

__all__ = ["Repeatability", "repeatability"]

FEWEST_UNITS = 8
# Frames beyond this are put together, to keep the number of fits in bounds.
MOST_UNITS = 60
SIGN_DRAWS = 20


@dataclass(frozen=True, eq=False)
class Repeatability:
    """Spread of mapped points over repeats of the scan.

    Attributes:
        corners: rms over the corners of the image area.
        centre: at its centre.
        places_px: (M, d): the corners, then the centre.
        places_mm: (M,): the spread at each.
    """

    corners: Quantity
    centre: Quantity
    places_px: Array
    places_mm: Array

    __repr__ = brief


def repeatability(calibration: Calibration, fitted: Observations, *, seed: int = 0) -> Repeatability:
    """Spread of mapped points over repeats of the same scan, from resampled subsets.

    The frames are halved at random, again and again; calibrations A and B of two halves share none. Their
    variances are those of scans so much shorter:

        spread^2 = mean over the splits of |A x - B x|^2 v(rows) / (v(rows of A) + v(rows of B))

    with v(m) = 1 / (2 m - k - 1): the variance of k parameters fitted to m rows of two equations each.

    The splits are balanced: every two frames are together as often as apart, so that chance in the choice of
    splits adds next to nothing.

    The true value that the interval is about: the standard deviation of A x, over all three axes, over
    repeats of the scan with as many new frames of the same kind. What all frames share, such as a wire
    that is not where the file says, repeats too and does not show here.

    Args:
        calibration: gives the model, the start and the image area.
        fitted: the rows that were fitted, without the outliers.
        seed: of the halvings.

    Raises:
        UnsupportedError: there are fewer than eight independent frames.
        DegenerateGeometryError: half of the frames leave a motion free.

    Source: Prager et al. 1998; Hsu et al. 2008 (calibration reproducibility); v is the mean of an
    inverse Wishart matrix (Mardia, Kent and Bibby 1979, section 3.8).
    """
    units = independent_units(calibration.probe_from_image, fitted)
    count = int(units.max()) + 1
    if count < FEWEST_UNITS:
        raise UnsupportedError(
            f"{fitted.source}: has {count} independent frames and repeatability needs {FEWEST_UNITS} or more; "
            "scan more frames"
        )
    units = units * min(MOST_UNITS, count) // count
    places = area_places(calibration.area_px)
    apart = _apart(calibration, fitted, units, places, seed)  # (splits, M), mm^2
    moved = _moved(calibration, fitted, units, places)  # (folds, M), mm^2
    k = _parameters(calibration)
    corners = _quantity(
        "repeatability-corners", "corners", apart[:, :-1], moved[:, :-1], units=count, parameters=k
    )
    centre = _quantity(
        "repeatability-centre", "centre", apart[:, -1:], moved[:, -1:], units=count, parameters=k
    )
    return Repeatability(corners, centre, places, np.sqrt(apart.mean(axis=0)))


def _apart(
    calibration: Calibration, rows: Observations, units: NDArray[np.int64], places: Array, seed: int
) -> Array:
    """Squared distance between the calibrations of disjoint parts, scaled to the variance of the whole scan."""
    squares = []
    for first in _balanced_halves(int(units.max()) + 1, seed):
        half = first[units]
        difference = refitted(calibration, rows, half) @ places - refitted(calibration, rows, ~half) @ places
        squares.append(np.sum(difference**2, axis=1) * _shrinkage(half, calibration))
    return np.array(squares)


def _parameters(calibration: Calibration) -> int:
    return unknowns(calibration.model, calibration.dimension)


def _shrinkage(half: NDArray[np.bool_], calibration: Calibration) -> float:
    """The whole scan's variance as a share of the sum of its two parts'."""
    parameters = _parameters(calibration)
    freedom = [max(2 * int(rows) - parameters - 1, 1) for rows in (len(half), half.sum(), (~half).sum())]
    return (1 / freedom[0]) / (1 / freedom[1] + 1 / freedom[2])


def _balanced_halves(count: int, seed: int) -> NDArray[np.bool_]:
    """Splits (R, count) of some units in two: any two units are together in half of them.

    Columns of a Hadamard matrix, which are orthogonal, with random signs; of some draws the one whose smallest
    part is largest.

    Source: balanced repeated replication (McCarthy 1969).
    """
    from scipy.linalg import hadamard

    rng, order = np.random.default_rng(seed), 1 << count.bit_length()
    matrix = hadamard(order)[:, 1 : count + 1] > 0
    best = matrix
    for _ in range(SIGN_DRAWS):
        drawn = matrix[:, rng.permutation(count)] ^ (rng.random(count) < 0.5)
        if _smallest_part(drawn) > _smallest_part(best):
            best = drawn
    return np.asarray(best)


def _smallest_part(halves: NDArray[np.bool_]) -> int:
    first = halves.sum(axis=1)
    return int(np.minimum(first, halves.shape[1] - first).min())


def _moved(calibration: Calibration, rows: Observations, units: NDArray[np.int64], places: Array) -> Array:
    """Squared displacement when one unit is left out: how unevenly the units make up the spread."""
    whole = refitted(calibration, rows, np.ones(len(rows), dtype=bool)) @ places
    return np.array(
        [
            np.sum((refitted(calibration, rows, units != unit) @ places - whole) ** 2, axis=1)
            for unit in range(int(units.max()) + 1)
        ]
    )


def _quantity(code: str, where: str, apart: Array, moved: Array, *, units: int, parameters: int) -> Quantity:
    value, contributions = float(apart.mean()), moved.mean(axis=1)
    # The spread's own uncertainty is that of a mean over the units' contributions.
    total = contributions.mean()
    # The fit has taken its parameters' part of them, two equations a unit.
    left = max(len(contributions) - parameters / 2.0, 1.0) / len(contributions)
    relative = (contributions - total) / max(total, np.finfo(float).tiny) / np.sqrt(left)
    low, high = log_interval(value, value * relative, np.arange(len(contributions)))
    return Quantity(
        code=code,
        title=f"Repeatability, {where}",
        definition=f"standard deviation of a mapped point at the image's {where} over repeats of the scan",
        value_mm=float(np.sqrt(value)),
        low_mm=float(np.sqrt(low)),
        high_mm=float(np.sqrt(high)),
        spread_mm=float(np.sqrt(apart).std()),
        count=len(apart),
        units=units,
    )
