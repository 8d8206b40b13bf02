"""Candidates grouped: rows of one candidate, candidates of one sighting."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.options import Options
from sonocal.calibration.rows import check_rows, point_line_rows
from sonocal.detection.detections import order_within
from sonocal.geometry import Array, AxisScaled
from sonocal.observations import Observations, group_codes, stacked
from sonocal.registration.best_fit import best_fit
from sonocal.registration.fit import Fit
from sonocal.registration.mirrored import refuse_mirrored_volume
from sonocal.registration.noise import residual_vectors

__all__ = ["TIGHTNESS", "Candidates", "Mask"]

Mask = NDArray[np.bool_]

LEAST_SHARE = 0.15
LEAST_SHARE_OF_MANY = 0.5
"""With several needles or wires: a wrong calibration that takes one for another agrees with a part of them."""
TIGHTNESS = {2: 4.0, 3: 5.0}
"""Standard deviations of the residuals within which a candidate is the needle, once a calibration is known.

Those of all rows: where a needle is seen near its end, tracking noise is up to 1.4 times what it is on average. Few
lines of a volume have both ends near the needle by chance, so that there is no need to lose any of its own."""


class Candidates:
    """A table of candidates: one row a candidate, best first within a frame and target; in 3D two or more rows.

    Args:
        rows: the table.
        options: how to fit.
        within_mm: candidates further than this from their needle are wrong.

    Attributes:
        rows, options, within_mm: as given.
        sighting: (N,) the image and needle of each row, counted from 0.
        count: how many sightings have a candidate.
        candidate: (N,) of each row, counted from 0.
        rank: (N,) of each row's candidate within its sighting, 0 for the best.
        owner: (M,) the sighting of each candidate.
    """

    def __init__(self, rows: Observations, options: Options, within_mm: float) -> None:
        self.rows, self.options, self.within_mm = rows, options, within_mm
        self._lines = point_line_rows(rows)
        self.sighting = group_codes(rows.frame, rows.target)
        self.count = int(self.sighting.max(initial=-1)) + 1
        if rows.dimension == 3:
            self.candidate = rows.sightings
            self.rank = np.array([int(name or 0) for name in rows.split], dtype=np.int64)
        else:
            self.candidate = np.arange(len(rows))
            self.rank = order_within(self.sighting)
        self.owner = self._of_candidates(self.sighting)
        # One candidate may be tried against several needles: each of its trials has the same place in the image.
        self._place = self._of_candidates(group_codes(rows.frame, *rows.points_px.T))

    def __len__(self) -> int:
        return len(self.owner)

    @property
    def shown(self) -> int:
        """Of what `agreeing` counts, how many have a candidate."""
        return self.count

    @property
    def of_one(self) -> bool:
        """Whether all candidates are of one target, of which an image shows one."""
        return len(np.unique(self.rows.target)) == 1

    @property
    def may_be_of_any(self) -> bool:
        """Whether a candidate's wire is asked for, as there are several: in images and in volumes."""
        return not self.of_one

    @property
    def least_share(self) -> float:
        """Of what is counted, the share that must agree: a wrong answer that mistakes one for another has a part."""
        return LEAST_SHARE if self.of_one else LEAST_SHARE_OF_MANY

    @property
    def counted(self) -> str:
        """What is counted: an image shows one needle once, and several wires each once."""
        return "images" if self.of_one else "sightings"

    @property
    def has_twins(self) -> bool:
        """Whether another one, or an echo, may have been chosen in its stead; wires are known to be several."""
        return self.of_one

    @property
    def wanted(self) -> str:
        """What messages call what is looked for."""
        return "the needle"

    def and_further(self, rows: Observations) -> Candidates:
        """These and further ones."""
        return Candidates(stacked([self.rows, rows]), self.options, self.within_mm)

    def at(self, chosen: Mask) -> Observations:
        """The chosen rows."""
        return self.rows.select(np.flatnonzero(chosen))

    def fit(self, chosen: Mask, threshold_mm: float | Literal["auto"] | None = None) -> Fit:
        """The transform that most of the chosen rows agree with: all that choosing needs of a calibration.

        Args:
            chosen: (N,) the rows to fit.
            threshold_mm: rows further than this from their line are outliers; default: `within_mm`.

        Raises:
            InputError: they are too few.
            NoConsensusError, DegenerateGeometryError: as `sonocal.calibrate`.
        """
        check_rows(self.at(chosen), self.options.model)
        options = replace(self.options, threshold_mm=self.within_mm if threshold_mm is None else threshold_mm)
        return best_fit(self._lines.select(chosen), options)[0]

    def transform(self, chosen: Mask) -> AxisScaled:
        """That of `fit`."""
        return self.fit(chosen).transform

    def consensus(self, chosen: Mask) -> AxisScaled:
        """That of `fit`, of rows of which many are wrong."""
        return self.transform(chosen)

    def refuse_mirrored(self, agreeing: int, least: float) -> None:
        """Name the mirror where it is why candidates in volumes were refused.

        Args:
            agreeing: how many sightings agreed as they stand.
            least: how many must agree for an answer.

        Raises:
            MirroredVolumeError: far more agree in mirrored volumes.
        """
        if self.rows.dimension == 2:
            return
        options = replace(self.options, threshold_mm=self.within_mm)
        for most in (1, len(self)):  # the best alone, then all
            keep = self.rank < most
            each = np.count_nonzero(keep) / np.unique(self.candidate[keep]).size
            lines = self._lines.select(keep)
            refuse_mirrored_volume(
                lines, options, int(each * agreeing), lambda *one: best_fit(*one)[0], least=int(each * least)
            )

    def nearest(self, transform: AxisScaled, closer_mm: float = np.inf) -> Mask:
        """(N,) rows of the nearest candidate of each sighting, where all of its points are within the threshold.

        Args:
            transform: carries points to their needles.
            closer_mm: a threshold below `within_mm`.

        Returns:
            A candidate that is nearest to several needles is that of the nearest one.
        """
        worst = np.zeros(len(self))
        np.maximum.at(worst, self.candidate, self._distances(transform))
        least = np.full(self.count, np.inf)
        np.minimum.at(least, self.owner, worst)
        best = np.flatnonzero((worst == least[self.owner]) & (worst <= min(self.within_mm, closer_mm)))
        best = best[np.argsort(worst[best], kind="stable")]
        best = best[np.unique(self._place[best], return_index=True)[1]]
        return np.isin(self.candidate, best)

    def places_mm(self, transform: AxisScaled) -> tuple[Array, Array]:
        """(M, 3) mm, along the image's axes: the middle of each candidate; and its direction, zeros of points."""
        points = self._lines.points * transform.scales
        middle, ends = np.zeros((len(self), 3)), np.zeros((len(self), 3))
        np.add.at(middle, self.candidate, points)
        middle /= np.maximum(np.bincount(self.candidate, minlength=len(self)), 1)[:, None]
        ends[self.candidate] = points - middle[self.candidate]  # of several points, the last one's
        lengths = np.linalg.norm(ends, axis=1, keepdims=True)
        return middle, ends / np.where(lengths > 0, lengths, 1.0)

    def agreeing(self, chosen: Mask) -> int:
        """How many sightings the chosen rows belong to."""
        return len(np.unique(self.sighting[chosen]))

    def by_chance(self, transform: AxisScaled) -> float:
        """Sightings that would agree if their candidates lay anywhere in the box that holds all of them."""
        area = np.prod(np.ptp(self.rows.points_px, axis=0)[:2] * transform.scales[:2])
        one = min(1.0, np.pi * self.within_mm**2 / max(float(area), 1e-9))
        if self.rows.dimension == 3:  # both ends of a line must agree
            one *= one
        return float(np.sum(1 - (1 - one) ** np.bincount(self.owner, minlength=self.count)))

    def weight(self, transform: AxisScaled, chosen: Mask, by_chance: float) -> float:
        """Of several transforms the one that weighs most is taken: sightings beyond chance."""
        return self.agreeing(chosen) - by_chance

    def fitting_threshold_mm(self, transform: AxisScaled, chosen: Mask) -> float:
        """How far a needle's own candidates may be from it, by the residuals of those chosen."""
        distance = self._distances(transform)[chosen]
        # The distance of a point to a line in space has two components: its median is 1.18 standard deviations.
        sigma = float(np.median(distance)) / 1.1774 if len(distance) else np.inf
        return TIGHTNESS[self.rows.dimension] * sigma

    def _of_candidates(self, of_rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """What the rows of a candidate share, once a candidate."""
        values = np.zeros(int(self.candidate.max(initial=-1)) + 1, dtype=np.int64)
        values[self.candidate] = of_rows
        return values

    def _distances(self, transform: AxisScaled) -> Array:
        """(N,) mm: of mapped points to their lines."""
        vectors = residual_vectors(transform, self._lines.points, self._lines.segments_mm)
        return np.asarray(np.linalg.norm(vectors, axis=1))
