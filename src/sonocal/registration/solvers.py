"""Minimal and linear solvers: points, lines and planes to a similarity.

Every solver takes leading batch axes and runs them in compiled code; without any, it solves one problem.
Noise often leaves a minimal sample without a real solution. With ``steps=0`` such a sample has count 0;
with more, the nearest real candidates are refined on every equation: `four_points`, `two_conics` and `two_lines` then
always have one, `three_quadrics` misses one noisy sample in some 700.
"""

from __future__ import annotations

from sonocal.registration.linear_solvers import linear_lines, linear_points
from sonocal.registration.minimal_solvers import (
    four_points,
    three_points,
    three_quadrics,
    two_conics,
    two_lines,
)
from sonocal.registration.paper_solvers import paper_four_points, paper_two_lines
from sonocal.registration.solver_calls import Solutions

__all__ = [
    "Solutions",
    "four_points",
    "linear_lines",
    "linear_points",
    "paper_four_points",
    "paper_two_lines",
    "three_points",
    "three_quadrics",
    "two_conics",
    "two_lines",
]
