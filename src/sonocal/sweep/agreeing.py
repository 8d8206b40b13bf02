"""How many sightings agree with a transform, and whether chance would bring as many together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonocal.geometry import AxisScaled
from sonocal.geometry.shown import brief
from sonocal.registration.robust import MINIMAL_ROWS
from sonocal.sweep.candidates import Candidates

__all__ = ["CLUTTER_FRAMES", "ENOUGH", "Agreeing"]

ENOUGH = 0.5
"""Share of the images that agree, from which no further ranks are tried than the next."""
CHANCE_FACTOR = 3.0
CLUTTER_FRAMES = 3
"""Neighbouring images that show the same clutter: so many count once where chance is weighed."""


@dataclass(frozen=True, eq=False)
class Agreeing:
    """A transform, how many sightings agree with it, how many would by chance, and what it weighs beside others."""

    transform: AxisScaled
    count: int
    by_chance: float
    weight: float = 0.0

    __repr__ = brief

    @classmethod
    def of(cls, table: Candidates, transform: AxisScaled) -> Agreeing:
        """What agrees with a transform."""
        chosen, by_chance = table.nearest(transform), table.by_chance(transform)
        weight = table.weight(transform, chosen, by_chance)
        return cls(transform, table.agreeing(chosen), by_chance, weight)

    @property
    def is_far_more(self) -> bool:
        """Whether no count is needed to see that this is no chance."""
        return self.count >= CHANCE_FACTOR * self.by_chance

    def is_enough(self, total: int) -> bool:
        """Whether hardly another rank is better."""
        return self.count >= ENOUGH * total and self.is_far_more

    def may_be_chance(self, table: Candidates) -> bool:
        """Whether as many would agree with some transform had candidates and needles nothing to do with each other.

        With many candidates in a small image chance alone brings a third of the sightings together, and three
        times that is more than there are. Then the number of false alarms tells: the binomial tail over all models
        that minimal samples could have given.

        Source: a-contrario model estimation (Moisan and Stival 2004).
        """
        from scipy.special import bdtrc, gammaln

        if self.is_far_more:
            return False
        sightings, agreeing = table.shown // CLUTTER_FRAMES, self.count // CLUTTER_FRAMES
        if agreeing <= MINIMAL_ROWS:
            return True
        combinations = (
            gammaln(sightings + 1) - gammaln(sightings - MINIMAL_ROWS + 1) - gammaln(MINIMAL_ROWS + 1)
        )
        samples = combinations + MINIMAL_ROWS * np.log(len(table) / table.shown)
        chance = min(self.by_chance / table.shown, 1.0)
        tail = bdtrc(agreeing - MINIMAL_ROWS - 1, sightings - MINIMAL_ROWS, chance)
        return bool(tail > 0 and samples + np.log(tail) > 0)
