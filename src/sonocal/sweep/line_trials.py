"""Where a recording's lines would be if something were other than it says, and how many of its images agree then."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from sonocal.calibration.rows import point_line_rows
from sonocal.detection import Detections
from sonocal.errors import InputError
from sonocal.geometry import Array, AxisScaled
from sonocal.observations import Observations
from sonocal.recording import Poses, Recording
from sonocal.registration.mapped import MappedRows
from sonocal.registration.near_degeneracy import nearly_degenerate
from sonocal.setup_checks.placement import GAIN, quick_fit
from sonocal.sweep.tabulate import Posing, tabulated
from sonocal.targets import Line

__all__ = ["GOOD_SHARE", "LEAST_LEFT", "RANKS", "LineTrials", "Share"]

# Ranks of candidates that are looked at: others are hardly ever the needle.
RANKS = 2
# Share of images in which one of these agrees where all is well.
GOOD_SHARE = 0.6
# Of trials under which as many agree, but for this share, that counts under which they do so most closely.
AS_MANY = 0.02
# Images that do not agree are looked at alone where they are as many, a share of all; chance brings few of them near.
FEWEST_LEFT, LEAST_LEFT, NEARLY_ALL = 8, 0.1, 0.8


@dataclass(frozen=True)
class Share:
    """How many images agree, of how many, the distance of the middle one of their rows from its line, the scale."""

    count: int
    of: int
    middle_mm: float
    mm_per_px: float = np.nan

    @property
    def part(self) -> float:
        """Of the images, how many agree."""
        return self.count / self.of


@dataclass(frozen=True, eq=False)
class LineTrials:
    """A recording, its lines, and what was detected: where lines would be, and what of the images agrees with that.

    Attributes:
        recording: with the poses as they are.
        lines: the needles and wires.
        detections: what was found in the images, candidates among them.
        posing: which tool the probe's marker is, and what connects the lines to it.
        threshold_mm: detections within this distance of their line agree.
    """

    recording: Recording
    lines: tuple[Line, ...]
    detections: Detections
    posing: Posing
    threshold_mm: float

    @cached_property
    def segments_mm(self) -> Array:
        """(N, L, 2, 3): the lines' ends as things stand, in every item."""
        return self.posing.segments_mm(self.recording, self.lines)

    def table(self, segments_mm: Array, ranks: int = RANKS) -> Observations:
        """The best candidates of each image against lines (N, L, 2, 3)."""
        best = self.detections.select(self.detections.rank < ranks)
        return tabulated(self.recording, self.lines, best, segments_mm).observations

    def with_poses(self, tools: list[str], change: Callable[[Array], Array]) -> Callable[[], Array]:
        """The lines' ends with some tools' poses changed."""
        names = {tool.lower() for tool in tools}
        poses = {
            name: replace(one, matrices=_changed(one, change)) if one.source.lower() in names else one
            for name, one in self.recording.poses.items()
        }
        return lambda: self.posing.segments_mm(replace(self.recording, poses=poses), self.lines)

    def longer(self, factor: float) -> Callable[[], Array]:
        """The lines' ends as if they were given in another unit."""
        lines = [replace(line, segment_mm=line.segment_mm * factor) for line in self.lines]
        return lambda: self.posing.segments_mm(self.recording, lines)

    def in_frame(self, frame: str) -> Callable[[], Array]:
        """The lines' ends as if they were given in another frame."""
        lines = [replace(line, frame=frame) for line in self.lines]
        return lambda: self.posing.segments_mm(self.recording, lines)

    def best(
        self, trials: dict[str, Callable[[], Array]], within: Mapping[str, float] = MappingProxyType({})
    ) -> str | None:
        """The trial under which most agree, in words with how many, if they are far more than as things stand.

        Args:
            trials: where the lines would be, by what is tried.
            within: parts of the threshold within which they agree, where less than all of it.
        """
        before = self.agreeing(lambda: self.segments_mm)
        shares = {words: self.agreeing(lines, within.get(words, 1.0)) for words, lines in trials.items()}
        most = max((share.part for share in shares.values()), default=0.0)
        alike = [one for one, share in shares.items() if share.part >= most - AS_MANY]
        words = min(alike, key=lambda one: shares[one].middle_mm, default="")
        if not shares or not shares[words].part > max(GOOD_SHARE, before.part + GAIN):
            return None
        if nearly_degenerate(point_line_rows(self.table(trials[words]()))):
            return None  # such lines fit many a change as well
        return f"{words}: {shares[words].count} of {shares[words].of} images agree then"

    def partly(self, trials: dict[str, Callable[[], Array]], transform: AxisScaled) -> str | None:
        """The trial under which images that do not agree with a transform do, in words, if nearly all of them are such.

        Args:
            trials: where the lines would be, by what is tried.
            transform: of the images that agree.
        """
        near = self._near(lambda: self.segments_mm, transform)
        left = sorted(frame for frame, agrees in near.items() if not agrees)
        if len(left) < max(FEWEST_LEFT, LEAST_LEFT * len(near)):
            return None
        counts = {}
        for words, segments in trials.items():
            then = self._near(segments, transform)
            counts[words] = sum(then.get(frame, False) for frame in left)
        words = max(counts, key=lambda one: counts[one], default="")
        if not counts or counts[words] < NEARLY_ALL * len(left):
            return None
        return (
            f"{words} in part of the recording: {counts[words]} of {len(left)} that do not agree do so then, the "
            f"first of them frame {left[0]}"
        )

    def _near(self, segments: Callable[[], Array], transform: AxisScaled) -> dict[int, bool]:
        """Of each image with a candidate, whether one lies near its line."""
        try:
            table = self.table(segments())
        except InputError:  # nothing connects such a frame to the probe
            return {}
        near = MappedRows(transform, point_line_rows(table)).distances <= self.threshold_mm
        found: dict[int, bool] = {}
        for frame, agrees in zip(table.frame.tolist(), near.tolist(), strict=True):
            found[frame] = found.get(frame, False) or agrees
        return found

    def agreeing(
        self, segments: Callable[[], Array], within: float = 1.0, scale_mm_per_px: float | None = None
    ) -> Share:
        """Sightings that agree with one transform, of those that have a candidate."""
        try:
            table = self.table(segments())
        except InputError:  # nothing connects such a frame to the probe
            return Share(0, 1, np.inf)
        sightings = len(np.unique(table.frame))
        fit = quick_fit(point_line_rows(table), within * self.threshold_mm, scale_mm_per_px)
        if fit is None:
            return Share(0, sightings, np.inf)
        agreeing = len(np.unique(table.frame[fit.inlier]))
        middle_mm = float(np.median(fit.residuals_mm[fit.inlier]))
        return Share(agreeing, sightings, middle_mm, float(fit.transform.scales[0]))


def _changed(poses: Poses, change: Callable[[Array], Array]) -> Array:
    """The matrices with the valid ones changed."""
    matrices = poses.matrices.copy()
    matrices[poses.valid] = change(matrices[poses.valid])
    return matrices
