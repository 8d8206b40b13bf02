"""What a registration of a phantom by its landmarks says: where it is, and how far to trust that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.geometry import Array, Similarity
from sonocal.geometry.shown import brief
from sonocal.registration.uncertainty import point_covariance, radius_95
from sonocal.tools.rests import Rest

__all__ = ["FeatureFit", "LandmarkFit", "PhantomRegistration", "TargetError"]


@dataclass(frozen=True, eq=False)
class LandmarkFit:
    """A landmark of the phantom, and how far its touch is from it.

    Attributes:
        name: of the landmark.
        at_mm: (3,), in the phantom's frame.
        touched_mm: (3,), where it was touched, in the reference's frame; None where it was not.
        distance_mm: of the touch from where the registration puts the landmark; None without a touch.
        frames: first and last item of each touch of it.
        used: it took part in the registration.
    """

    name: str
    at_mm: Array
    touched_mm: Array | None
    distance_mm: float | None
    frames: tuple[tuple[int, int], ...]
    used: bool

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class FeatureFit:
    """A line or plane of the phantom, and how far from it the stylus was dragged.

    Attributes:
        name: of it.
        kind: "line" or "plane".
        distance_mm: of the line or plane that the tip went along from it, root mean square over the drag, without the
            noise of single places; None where it was not dragged along.
        spread_mm: of single places of the tip about that, along an axis; None likewise.
        frames: first and last item of the drag.
        used: it took part in the registration.
    """

    name: str
    kind: str
    distance_mm: float | None
    spread_mm: float | None
    frames: tuple[tuple[int, int], ...]
    used: bool

    __repr__ = brief


@dataclass(frozen=True)
class TargetError:
    """How far a wire or another target may be off because of the registration.

    Attributes:
        name: of the target.
        within_95_mm: what the registration moves it by at most in 95 of 100 cases, where it moves it most.
    """

    name: str
    within_95_mm: float

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class PhantomRegistration:
    """Where a phantom is, and how far to trust it.

    Attributes:
        phantom: the phantom's frame.
        reference: the frame that it is registered in.
        reference_from_phantom: (4, 4).
        covariance: (6, 6): rotation vector (applied on the left, rad), translation (mm).
        freedom: residuals to spare; quantiles are Student's with so many.
        landmarks: as listed, touched or not.
        rests: where the stylus rested, in the order recorded.
        rms_mm: of the distances of the landmarks used.
        size_ratio: of the similarity that fits best, beside 1: a check of units, and of a printed phantom.
        size_ratio_deviation: of it.
        as_listed: the landmarks were touched in the order listed.
        target_errors: of the phantom's wires and planes, worst first.
        diagnostics: what to know before use, warnings first.
        features: lines and planes that the stylus was dragged along, as listed, whether it was or not.
    """

    phantom: str
    reference: str
    reference_from_phantom: Array
    covariance: Array
    freedom: int
    landmarks: tuple[LandmarkFit, ...]
    rests: tuple[Rest, ...]
    rms_mm: float
    size_ratio: float
    size_ratio_deviation: float
    as_listed: bool
    target_errors: tuple[TargetError, ...]
    diagnostics: tuple[Diagnostic, ...]
    features: tuple[FeatureFit, ...] = ()

    __repr__ = brief

    @property
    def used(self) -> int:
        """How many landmarks, lines and planes took part."""
        of_all: tuple[LandmarkFit | FeatureFit, ...] = (*self.landmarks, *self.features)
        return sum(one.used for one in of_all)

    @property
    def mean_mm(self) -> float:
        """Mean distance of what was used, which PLUS writes as the transform's ``Error``."""
        of_all: tuple[LandmarkFit | FeatureFit, ...] = (*self.landmarks, *self.features)
        return float(np.mean([one.distance_mm for one in of_all if one.used and one.distance_mm is not None]))

    @property
    def worst(self) -> LandmarkFit | FeatureFit:
        """The landmark, line or plane that the stylus was furthest from."""
        of_all: tuple[LandmarkFit | FeatureFit, ...] = (*self.landmarks, *self.features)
        return max(of_all, key=lambda one: -1.0 if one.distance_mm is None else one.distance_mm)

    def within_95_mm(self, points_mm: Array) -> Array:
        """(N,) mm: what the registration moves points (N, 3) of the phantom by at most in 95 of 100 cases."""
        motion = Similarity.from_matrix(self.reference_from_phantom)
        return radius_95(point_covariance(motion, self.covariance, points_mm), self.freedom)
