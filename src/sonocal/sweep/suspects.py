"""What may be wrong with a recording in which few sightings agree: its clocks, its poses, the frame of its lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sonocal.calibration import Calibration
from sonocal.calibration.models import CHECK_SCALE
from sonocal.calibration.options import Options
from sonocal.calibration.refusals import leading_with
from sonocal.calibration.rows import point_line_rows
from sonocal.errors import DegenerateGeometryError, MirroredVolumeError, NoConsensusError
from sonocal.findings import Diagnostic, Findings
from sonocal.geometry import Array, AxisScaled
from sonocal.geometry.units import GO_ON, length_hints, unit_doubt
from sonocal.recording.mistaken_poses import CHANGES
from sonocal.setup_checks.lag_search import Lag, find_lag
from sonocal.setup_checks.late import lag_finding, spoiling_lag
from sonocal.setup_checks.latency import LEAST_LAG_MM
from sonocal.setup_checks.placement import GAIN, USUAL_MM, wrong_frame
from sonocal.setup_checks.rows_in_time import RowsInTime
from sonocal.setup_checks.threshold import (
    ENOUGH_DEVIATIONS,
    PART_OF_IMAGE,
    noise_of_middle,
    threshold_too_small,
)
from sonocal.sweep.agreeing import ENOUGH
from sonocal.sweep.line_trials import GOOD_SHARE, LEAST_LEFT, RANKS, LineTrials

__all__ = ["Suspects"]

OF = "'s"
# Share of the images' best candidates that agree where all is well, others lie on clutter.
LEAST_SHARE = 0.25
# Share of the sightings below which it is asked why not more took part: needles are out of view for a while.
FEW = 0.7
OF_A_LAG = {"latency", "latency-beyond-tolerance"}
# What a suspect explains better than the calibration did.
BETTER_SAID = {"latency", "wrong-tool-frame", "known-scale-unchecked"}
# What poses of which a part is written otherwise look like.
OF_MIXED_POSES = BETTER_SAID | {
    *OF_A_LAG,
    "marker-slipped",
    "two-markers",
    "left-out-rows-agree",
}

UNITS_MM = {"mm": 1.0, "cm": 10.0, "inches": 25.4, "metres": 1000.0}
FACTORS = {
    (of, to): UNITS_MM[of] / UNITS_MM[to]
    for of in UNITS_MM
    for to in UNITS_MM
    if of != to and {of, to} != {"metres", "inches"}
}
"""What lengths of lines are multiplied by that are in one unit, where poses are in another."""


@dataclass(frozen=True, eq=False)
class Suspects:
    """A recording and what was detected in it, to be asked what would fit better.

    Attributes:
        trials: what agrees if something is other than the recording says.
        options: how rows are fitted.
    """

    trials: LineTrials
    options: Options

    @contextmanager
    def explaining(self) -> Iterator[None]:
        """Within it, a refusal leads with what explains it."""
        try:
            yield
        except MirroredVolumeError:  # which says itself what it comes from
            raise
        except (NoConsensusError, DegenerateGeometryError) as error:
            if found := self.findings(getattr(error, "best_count", None)):
                error.explained(found, leading_with(found, error.refusal or str(error)))
            raise

    def judging(self, calibration: Calibration, used: int, sightings: int) -> Calibration:
        """The calibration, with what is suspect where few sightings took part, looked for when its findings are read.

        Args:
            calibration: of the sightings that agree.
            used: how many do.
            sightings: of how many.
        """

        def look() -> tuple[Diagnostic, ...]:
            own = tuple(calibration.diagnostics)
            mixed = used < (1.0 - LEAST_LEFT) * sightings
            if mixed and (found := tuple(self._mixed_poses(calibration.probe_from_image))):
                return (*found, *(one for one in own if one.code not in OF_MIXED_POSES))
            if used >= FEW * sightings and not any(one.code == "latency" for one in own):
                return own
            found = self.findings(used)
            if self._lag is not None:
                accepted = calibration.area_px, self.options.tolerance_mm, calibration.area_name
                found += tuple(spoiling_lag(self._lag, calibration.probe_from_image, accepted))
            better = {one.code for one in found} | (BETTER_SAID if found else set())
            # Few may agree by chance, and then follow the needle's speed as well.
            if used < ENOUGH * sightings:
                better |= OF_A_LAG
            return (*found, *(one for one in own if one.code not in better))

        return replace(calibration, diagnostics=Findings(looks=(look,)))

    def findings(self, agreeing: int | None = None) -> tuple[Diagnostic, ...]:
        """What explains that few agree: the first suspect that does is named, and no other.

        Args:
            agreeing: how many sightings do, where that is said beside.
        """
        if found := tuple(self._wrong_places()):
            return found
        looks = (
            self._wrong_scale,
            self._wrong_unit,
            self._late,
            self._low_threshold,
            self._wrong_poses,
            self._wrong_frame,
        )
        for look in looks:
            if found := tuple(look()):
                said = "" if agreeing is None else f", instead of {agreeing}"
                return tuple(replace(one, message=one.message + said) for one in found)
        return ()

    @cached_property
    def _lag(self) -> Lag | None:
        """Lines from another moment: the poses of all items say where they were, not only those with a detection."""
        if np.isnan(self.trials.recording.times).any():
            return None
        lags = (self._lag_of(ranks) for ranks in (1, RANKS))
        return next((lag for lag in lags if lag is not None and lag.moved_mm > LEAST_LAG_MM), None)

    def _lag_of(self, ranks: int) -> Lag | None:
        """From so many candidates an image: the first are the surest, and in speckle too few of them the needle."""
        table = self.trials.table(self.trials.segments_mm, ranks)
        names = [line.name for line in self.trials.lines]
        track = np.array([names.index(str(name)) for name in table.target])
        rows = RowsInTime.in_recording(
            point_line_rows(table), self.trials.recording.times, self.trials.segments_mm, table.frame, track
        )
        return find_lag(rows, self.trials.threshold_mm, self.options.model, LEAST_SHARE)

    def _wrong_places(self) -> Iterator[Diagnostic]:
        """Places of the image, all axes or one, in shares of it."""
        places = self.trials.detections.points_px
        hints = length_hints(places.reshape(-1, places.shape[-1]), np.zeros(0))
        yield from (replace(one, advice=one.advice.removesuffix(GO_ON)) for one in unit_doubt(hints))

    def _wrong_scale(self) -> Iterator[Diagnostic]:
        """Images that agree once the scale is left free."""
        given = self.options.scale_mm_per_px
        if given is None:
            return
        known = self.trials.agreeing(lambda: self.trials.segments_mm, scale_mm_per_px=given)
        free = self.trials.agreeing(lambda: self.trials.segments_mm)
        if free.part > max(GOOD_SHARE, known.part + GAIN):
            yield Diagnostic(
                code="known-scale-disagrees",
                severity="warning",
                message=(
                    f"the rows contradict the scale that was given: {free.count} of {free.of} images agree at "
                    f"{free.mm_per_px:.5f} mm/px, and {given:.5f} were given"
                ),
                advice=CHECK_SCALE,
            )

    def _wrong_unit(self) -> Iterator[Diagnostic]:
        """Lines that fit when they are taken to be in another unit than the poses."""
        trials, within = {}, {}
        for (of, to), factor in FACTORS.items():
            words = f"the lines fit when their lengths are multiplied by {factor:.4g} ({of}, where poses are in {to})"
            # Lines that shrink come near one another, and chance with them.
            trials[words], within[words] = self.trials.longer(factor), min(factor, 1.0)
        found = self.trials.best(trials, within)
        if found is not None:
            yield Diagnostic(
                code="implausible-units",
                severity="warning",
                message=found,
                advice="give the lines' file and the poses in mm, both",
            )

    def _late(self) -> Iterator[Diagnostic]:
        if self._lag is not None:
            yield lag_finding(self._lag, self.trials.recording.latency_s)

    def _low_threshold(self) -> Iterator[Diagnostic]:
        """A threshold that leaves out what is noise: most agree within what is usual."""
        within_mm = self.trials.threshold_mm
        if self.options.threshold_mm == "auto" or within_mm >= USUAL_MM:
            return
        share = self.trials.agreeing(lambda: self.trials.segments_mm, USUAL_MM / within_mm)
        image = self.trials.recording.image
        extent_mm = share.mm_per_px * max(image.size_px) if image else 0.0
        if share.part > GOOD_SHARE and PART_OF_IMAGE * extent_mm >= USUAL_MM:
            noise_mm = noise_of_middle(share.middle_mm)
            yield threshold_too_small(
                f"with a noise of {noise_mm:.2g} mm per axis, which the threshold of {within_mm:.3g} mm leaves out, "
                f"{share.count} of {share.of} images agree",
                ENOUGH_DEVIATIONS * noise_mm,
            )

    def _wrong_poses(self) -> Iterator[Diagnostic]:
        """Poses that fit when they are taken for something else."""
        yield from self._of_poses(self.trials.best(self._changes()))

    def _mixed_poses(self, transform: AxisScaled) -> Iterator[Diagnostic]:
        """Poses of which a part fits when it is taken for something else."""
        yield from self._of_poses(self.trials.partly(self._changes(), transform))

    def _changes(self) -> dict[str, Callable[[], Array]]:
        """Where the lines would be, were poses something else, by what they would be."""
        frames = dict.fromkeys([self.trials.posing.probe, *(line.frame for line in self.trials.lines)])
        tools = [one for one in frames if self._is_tracked(one)]
        whose = [*([tool] for tool in tools), *([tools] if len(tools) > 1 else [])]
        return {
            f"the {' and the '.join(tool + OF for tool in some)} poses fit when they are {how}": (
                self.trials.with_poses(some, change)
            )
            for some in whose
            for how, change in CHANGES.items()
        }

    def _of_poses(self, found: str | None) -> Iterator[Diagnostic]:
        probe = self.trials.posing.probe
        if found is not None:
            yield Diagnostic(
                code="wrong-poses",
                severity="warning",
                message=found,
                advice=(
                    f"write them as they are meant: a transform named {probe}ToTracker carries points of "
                    f"the {probe} into the tracker's frame, and the numbers of a quaternion have an order"
                ),
            )

    def _wrong_frame(self) -> Iterator[Diagnostic]:
        """Lines that fit in the frame of another tool, or in the tracker's."""
        said, known = self.trials.lines[0].frame, self.trials.recording.poses.values()
        names = dict.fromkeys([*self.trials.recording.tools, *(one.target for one in known)])
        own = {line.frame.lower() for line in self.trials.lines}
        words = "the lines fit when they are taken to be in the frame of {}, not of {}"
        others = [name for name in names if name.lower() not in own]
        found = self.trials.best({words.format(name, said): self.trials.in_frame(name) for name in others})
        if found is not None:
            yield wrong_frame(
                found, "correct the frame in the file of lines, or carry the lines into the one it names"
            )

    def _is_tracked(self, tool: str) -> bool:
        return sum(one.source.lower() == tool.lower() for one in self.trials.recording.poses.values()) == 1
