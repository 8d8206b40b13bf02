"""The paper's methods and ours, by name, on many trials at a time."""

from __future__ import annotations

from dataclasses import dataclass

from sonocal import _core
from sonocal.geometry import Array
from sonocal.studies.scene import Scene, Trials

__all__ = ["METHODS", "Method", "run_method"]

# Of RANSAC with plain hypotheses; `sonocal` searches as calibrate() does.
CONFIDENCE, MAX_SAMPLES = 0.99, 1000


@dataclass(frozen=True)
class Method:
    """How a calibration is found.

    Attributes:
        solver: of the hypotheses: the core's name.
        fewest: needles that it needs, by the probe's dimension; it applies to no other.
        likelihood: the whole of `calibrate()` after refinement; otherwise the paper's cost (section 8).
        about: what it is.
    """

    solver: str
    fewest: dict[int, int]
    likelihood: bool = False
    about: str = ""

    def applies(self, scene: Scene) -> bool:
        """Whether it can run on such a scene."""
        return scene.needles >= self.fewest.get(scene.dimension, scene.needles + 1)

    @property
    def needs(self) -> str:
        """What it needs, in words."""
        kinds = " or ".join(f"{n} needles of a {d}D probe" for d, n in self.fewest.items())
        return f"it needs {kinds}"


METHODS = {
    "5point2D": Method("linear", {2: 5}, about="linear, paper section 6.1"),
    "3line3D": Method("linear", {3: 3}, about="linear, paper section 5.2"),
    "4point2D": Method("paper_four_points", {2: 4}, about="minimal, paper section 6.2"),
    "2line3D": Method("paper_two_lines", {2: 4, 3: 2}, about="minimal, paper section 5.3"),
    "four_points": Method("closed_form", {2: 4}, about="two conics"),
    "two_lines": Method("closed_form", {3: 2}, about="closed form"),
    "sonocal": Method("closed_form", {2: 4, 3: 2}, likelihood=True, about="as calibrate() does it"),
}


def run_method(name: str, scene: Scene, trials: Trials, *, threshold_mm: float) -> tuple[Array, Array]:
    """A method's answers to many trials.

    RANSAC over samples of needles (all of them where they are few), scored by truncated squared distances; a
    linear method solves again on all rows that agree with the winner. That is before refinement; after it, the
    paper's methods have minimised distances on the rows that agree, and `sonocal` has run whole, noise levels
    estimated.

    Args:
        name: of METHODS.
        scene: of the trials.
        trials: what is measured.
        threshold_mm: rows within this distance agree.

    Returns:
        Before and after refinement, (T, 4, 4) each, mm from px; NaN where there is no answer.
    """
    method = METHODS[name]
    return _core.study_trials(
        trials.points,
        trials.segments,
        trials.seeds,
        dimension=scene.dimension,
        solver=method.solver,
        likelihood=method.likelihood,
        threshold_mm=threshold_mm,
        level_px=0.0,
        level_mm=0.0,
        confidence=CONFIDENCE,
        max_samples=MAX_SAMPLES,
        threads=1,
    )
