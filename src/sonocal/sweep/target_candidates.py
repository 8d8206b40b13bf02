"""Candidates for points, lines and planes: grouped by target to choose, counted by image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sonocal.calibration.mixed import table_of
from sonocal.calibration.options import Options
from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError, SonocalError
from sonocal.geometry import Array, AxisScaled
from sonocal.observations import Observations, group_codes
from sonocal.registration.best_fit import consensus_fit
from sonocal.registration.mapped import mapped_rows
from sonocal.registration.options import MOST_SAMPLES
from sonocal.sweep.candidates import Candidates, Mask

__all__ = ["TargetCandidates"]

LEAST_SHARE = 0.3
"""Of the images: a wrong calibration that takes one wall for another agrees with a part of them."""
TIGHTNESS = 4.0
MORE_SAMPLES = 10
"""As many as an estimate takes, where few rows are right: of candidates that are tried against four targets, one in
twenty."""
LEVELS = np.geomspace(0.01, 0.5, 24)
"""Of the threshold: standard deviations of residuals that are tried."""
OF_ECHO = 2.0
"""What an echo that is taken for a wall weighs: of what is told to be one, one in nine is a wall, about."""
CLOSER = (1.0, 0.4, 0.16)
"""Of the threshold: how closely rows must agree."""


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
    def may_be_of_any(self) -> bool:
        """Targets of several kinds are chosen among, not labelled."""
        return False

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
        return self._fitted(chosen, self.within_mm)

    def consensus(self, chosen: Mask) -> AxisScaled:
        """Of transforms that most of the rows agree with, more and less closely, the one that weighs most.

        A candidate is tried against every target of its kind, and within some millimetres of a wall lies many a
        wrong one: the widest threshold finds what the closer ones are too close for.

        Raises:
            NoConsensusError, DegenerateGeometryError, InputError: as `fit_targets`.
        """
        found: list[AxisScaled] = []
        refusal: SonocalError | None = None
        for share in CLOSER:
            try:
                found.append(self._fitted(chosen, share * self.within_mm, MORE_SAMPLES))
            except (NoConsensusError, DegenerateGeometryError, InputError) as error:
                refusal = refusal or error
        if not found:
            assert refusal is not None
            raise refusal
        return max(found, key=lambda one: self.weight(one, self.nearest(one), 0.0))

    def _fitted(self, chosen: Mask, threshold_mm: float, more: int = 1) -> AxisScaled:
        samples = min(more * self.options.max_samples, MOST_SAMPLES)
        options = replace(self.options, threshold_mm=threshold_mm, max_samples=samples)
        return consensus_fit(self._table.select(chosen), options).transform

    def refuse_mirrored(self, agreeing: int, least: float) -> None:
        """`register` has looked."""

    def agreeing(self, chosen: Mask) -> int:
        """In how many images something was chosen."""
        return len(np.unique(self.rows.frame[chosen]))

    def by_chance(self, transform: AxisScaled) -> float:
        """Images that would agree as closely if their candidates lay anywhere in the box that holds all of them."""
        sides = np.ptp(self.rows.points_px, axis=0)[:2] * transform.scales[:2]
        side = max(float(np.sqrt(np.prod(sides))), 1e-9)
        within = min(self.within_mm, self.fitting_threshold_mm(transform, self.nearest(transform)))
        near, beside = min(1.0, np.pi * (within / side) ** 2), min(1.0, 2 * within / side)
        points = np.bincount(self.candidate)
        planes = self._of_candidates(self.rows.spans.astype(np.int64)) == 3
        alone = np.where(planes, beside**points, near**points)
        none = np.bincount(self._image, np.log1p(-np.minimum(alone, 1 - 1e-12)))
        return float(np.sum(1 - np.exp(none)))

    def weight(self, transform: AxisScaled, chosen: Mask, by_chance: float) -> float:
        """How unlikely it is that so many candidates agree so well by chance, at whatever level they agree best at.

            max over s of sum log(1 + t / s exp(-r^2 / 2 s^2))        t: the threshold, r: a candidate's residual

        A transform that takes echoes of walls for walls, as they lie within the threshold, has more of them and fits
        them worse; one that fits some exactly, others worse. And a wall that did not come first in its image was told
        to be an echo there.
        """
        rows = np.flatnonzero(chosen)
        used, of_row = np.unique(self.candidate[rows], return_inverse=True)
        squares = self._distances(transform)[rows] ** 2 / (4 - self.rows.spans[rows])
        square = np.bincount(of_row, squares) / np.bincount(of_row)
        levels = self.within_mm * LEVELS[:, None]
        agreed = np.log1p(self.within_mm / levels * np.exp(-0.5 * square / levels**2)).sum(axis=1)
        echoes = np.unique(self.candidate[chosen & (self.rank > 0) & (self.rows.spans == 3)])
        return float(agreed.max()) - OF_ECHO * len(echoes) if len(used) else 0.0

    def fitting_threshold_mm(self, transform: AxisScaled, chosen: Mask) -> float:
        """How far a target's own candidates may be from it, by the residuals of those chosen."""
        return TIGHTNESS * self._level_mm(transform, chosen)

    def _level_mm(self, transform: AxisScaled, chosen: Mask) -> float:
        """Standard deviation of the chosen rows' residuals, of each kind its own.

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
        return max(levels, default=np.inf)

    def _distances(self, transform: AxisScaled) -> Array:
        return np.asarray(mapped_rows(transform, self._table).distances)
