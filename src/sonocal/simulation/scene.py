"""Simulated sightings of a needle with known truth, by the paper's protocol."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array, Similarity
from sonocal.observations import Observations

__all__ = ["IMAGE_PX", "PAPER_SCALE_MM_PER_PX", "SimulatedSightings", "simulate_observations"]

PAPER_SCALE_MM_PER_PX = 0.24
NEEDLE_MM = 400.0
IMAGE_PX = 500
MARKER_DISTANCE_MM = 100.0


@dataclass(frozen=True, eq=False)
class SimulatedSightings:
    """Sightings and what is true of them.

    Attributes:
        observations: the table that a user would have.
        probe_from_image: the true calibration.
        outlier: (N,): whether the row's image point is gross nonsense.
    """

    observations: Observations
    probe_from_image: Similarity
    outlier: NDArray[np.bool_]


def simulate_observations(
    dimension: int = 2,
    needles: int = 50,
    *,
    sigma_px: float = 1.0,
    sigma_mm: float = 1.0,
    outlier_share: float = 0.0,
    scale_mm_per_px: float = PAPER_SCALE_MM_PER_PX,
    seed: int = 0,
) -> SimulatedSightings:
    """Sightings of a needle at random poses through the field of view.

    A needle of 400 mm lies at random through an image of 500 x 500 px (500 x 500 x 500 in 3D) of
    0.24 mm a pixel; image points get normal noise along every axis, and so do the needle's end points.
    A 2D probe sees the needle where it crosses the image, a 3D probe at two points.

    Args:
        dimension: 2 or 3, the probe's.
        needles: how many poses.
        sigma_px: noise of an image point along each axis, px.
        sigma_mm: tracking noise of an end point along each axis, mm.
        outlier_share: share of the needles, 0 to 1, whose image points are uniform over the image.
        scale_mm_per_px: true scale.
        seed: of everything random.

    Raises:
        InputError: a number makes no sense.

    Source: paper section 9.1.
    """
    _check(dimension, needles, sigma_px, sigma_mm, outlier_share)
    rng = np.random.default_rng(seed)
    truth = Similarity(_random_rotation(rng), rng.uniform(-1, 1, 3) * MARKER_DISTANCE_MM, scale_mm_per_px)

    per_needle = dimension - 1
    places = np.zeros((needles, per_needle, 3))
    places[..., :dimension] = rng.uniform(0, IMAGE_PX, (needles, per_needle, dimension))
    points_mm = truth @ places
    along = rng.normal(size=(needles, 3)) if dimension == 2 else points_mm[:, 1] - points_mm[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # The image is somewhere along the needle, not always at its middle.
    before = rng.uniform(0.1, 0.9, (needles, 1)) * NEEDLE_MM
    middle = points_mm.mean(axis=1)
    segments = np.stack([middle - before * along, middle + (NEEDLE_MM - before) * along], axis=1)

    places[..., :dimension] += rng.normal(scale=sigma_px, size=(needles, per_needle, dimension))
    segments += rng.normal(scale=sigma_mm, size=segments.shape)
    outlier = rng.permutation(needles) < round(outlier_share * needles)
    nonsense = rng.uniform(0, IMAGE_PX, (needles, per_needle, dimension))
    places[outlier, :, :dimension] = nonsense[outlier]
    frame = np.repeat(np.arange(needles), per_needle)
    observations = Observations(
        points_px=places[..., :dimension].reshape(-1, dimension),
        segments_mm=segments[frame],
        frame=frame,
        image_size_px=(IMAGE_PX,) * dimension,
        source=f"simulation (seed {seed})",
    )
    return SimulatedSightings(observations, truth, outlier[frame])


def _random_rotation(rng: np.random.Generator) -> Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.random(random_state=rng).as_matrix())


def _check(dimension: int, needles: int, sigma_px: float, sigma_mm: float, outlier_share: float) -> None:
    if dimension not in (2, 3):
        raise InputError(f"a probe has 2 or 3 dimensions; got {dimension}")
    if needles < 1:
        raise InputError(f"a simulation needs at least one needle; got {needles}")
    if not (sigma_px >= 0 and sigma_mm >= 0):
        raise InputError(f"noise cannot be negative; got {sigma_px} px and {sigma_mm} mm")
    if not 0 <= outlier_share < 1:
        raise InputError(f"the share of outliers is at least 0 and less than 1; got {outlier_share}")
