"""Candidates for points, lines and planes: grouped by target to choose, counted by image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sonocal.calibration.mixed import table_of
from sonocal.calibration.options import Options
from sonocal.geometry import Array, AxisScaled
from sonocal.observations import Observations, group_codes
from sonocal.registration.best_fit import consensus_fit
from sonocal.registration.mapped import mapped_rows
from sonocal.sweep.candidates import Candidates, Mask

__all__ = ["TargetCandidates"]

LEAST_SHARE = 0.3
"""Of the images: a wrong calibration that takes one wall for another agrees with a part of them."""
TIGHTNESS = 4.0


class TargetCandidates(Candidates):
    """As `Candidates`, of whatever targets, each image of which shows some.

    Args:
        rows: the table: one row a point of a candidate; a candidate's number within its image, for each kind that is
            looked for, is its `split`, and the best has the number 0.
        options: how to fit.
        within_mm: candidates further than this from their target are wrong.
    """

    def __init__(self, rows: Observations, options: Options, within_mm: float) -> None:
        self.rows, self.options, self.within_mm = rows, options, within_mm
        self._table = table_of(rows)
        self.sighting = group_codes(rows.frame, rows.target)
        self.count = int(self.sighting.max(initial=-1)) + 1
        self.candidate = rows.sightings
        self.rank = np.array([int(name or 0) for name in rows.split], dtype=np.int64)
        self.owner = self._of_candidates(self.sighting)
        self._image = self._of_candidates(group_codes(rows.frame))
        # One candidate may be tried against several targets: each of its trials has the same place in the image.
        self._place = self._of_candidates(group_codes(rows.frame, rows.split, rows.spans == 3))

    @property
    def shown(self) -> int:
        """Images with a candidate."""
        return int(self._image.max(initial=-1)) + 1

    @property
    def least_share(self) -> float:
        """Of the images that must agree."""
        return LEAST_SHARE

    @property
    def counted(self) -> str:
        """An image shows one target or several."""
        return "images"

    @property
    def has_twins(self) -> bool:
        """Echoes of walls are told by the images that show both."""
        return False

    @property
    def wanted(self) -> str:
        """What messages call what is looked for."""
        return "a target"

    def at(self, chosen: Mask) -> Observations:
        """The chosen rows; of one frame and target there is one candidate among them."""
        rows = self.rows.select(np.flatnonzero(chosen))
        return rows.with_sound(split=np.full(len(rows), ""))

    def transform(self, chosen: Mask) -> AxisScaled:
        """The transform that most of the chosen rows agree with.

        Raises:
            NoConsensusError, DegenerateGeometryError, InputError: as `fit_targets`.
        """
        options = replace(self.options, threshold_mm=self.within_mm)
        return consensus_fit(self._table.select(chosen), options).transform

    def refuse_mirrored(self, agreeing: int, least: float) -> None:
        """`register` has looked."""

    def agreeing(self, chosen: Mask) -> int:
        """In how many images something was chosen."""
        return len(np.unique(self.rows.frame[chosen]))

    def by_chance(self, transform: AxisScaled) -> float:
        """Images that would agree if their candidates lay anywhere in the box that holds all of them."""
        sides = np.ptp(self.rows.points_px, axis=0)[:2] * transform.scales[:2]
        side = max(float(np.sqrt(np.prod(sides))), 1e-9)
        near, beside = min(1.0, np.pi * (self.within_mm / side) ** 2), min(1.0, 2 * self.within_mm / side)
        points = np.bincount(self.candidate)
        planes = self._of_candidates(self.rows.spans.astype(np.int64)) == 3
        alone = np.where(planes, beside**points, near**points)
        none = np.bincount(self._image, np.log1p(-np.minimum(alone, 1 - 1e-12)))
        return float(np.sum(1 - np.exp(none)))

    def fitting_threshold_mm(self, transform: AxisScaled, chosen: Mask) -> float:
        """How far a target's own candidates may be from it, by the residuals of those chosen, of each kind its own.

        A distance has as many components as are held: three at a point, two on a line, one in a plane. The largest
        of the kinds' levels counts, as few sightings of a kind tell little.
        """
        distances, spans = self._distances(transform)[chosen], self.rows.spans[chosen]
        # Medians of the length of so many normal deviates, in standard deviations.
        medians = {1: 1.538, 2: 1.177, 3: 0.674}
        levels = [
            float(np.median(distances[spans == kind])) / usual
            for kind, usual in medians.items()
            if (spans == kind).any()
        ]
        return TIGHTNESS * max(levels, default=np.inf)

    def _distances(self, transform: AxisScaled) -> Array:
        return np.asarray(mapped_rows(transform, self._table).distances)
