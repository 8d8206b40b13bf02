"""From a recording of a needle to a calibration: detection, the table of candidates, choice, a second look.

A needle's point takes seven forms between its image and the file:

1. a row of the core's array of blobs; in a volume, a `LineCandidate`
2. points, covariances and scores of one image, from the detector
3. `Detections` of the recording, checked here and nowhere later
4. `Observations`: each detection against its line in the probe marker's frame (`tabulate`); choosing selects rows of it
5. `PointLineRows`: the columns that registration takes, selected by masks
6. the core's own table of them, whose lengths and signs it checks
7. the text of ``observations.csv``: the chosen rows, with the name and digest that validation will know them by
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Unpack

import numpy as np

from sonocal.calibration import Calibration, calibrate, placed_by, seen_at_assumed_speed
from sonocal.calibration.lagged import lag_of_rows, with_lag
from sonocal.detection import Detections
from sonocal.detection.recordings import Detector, detector_of
from sonocal.errors import NoConsensusError, require
from sonocal.geometry import Array, AxisScaled
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.recording import Recording, with_latency
from sonocal.recording.health import Progress
from sonocal.sweep.choice import CandidateCalibration, calibrate_chosen
from sonocal.sweep.lagged import (
    lag_of_candidates,
    lag_of_points,
    most_used,
    moving_rows,
    require_clock,
    with_line_velocities,
)
from sonocal.sweep.line_trials import LineTrials
from sonocal.sweep.mixed import calibrate_targets
from sonocal.sweep.options import (
    Keywords,
    Options,
    PointsKeywords,
    PointsOptions,
    of_calibrate,
    telling_threshold_mm,
)
from sonocal.sweep.placed import placed_rows
from sonocal.sweep.pose_errors import with_pose_errors
from sonocal.sweep.recorded import as_recorded
from sonocal.sweep.second_look import SecondLook
from sonocal.sweep.slice_noise import with_slice_noise
from sonocal.sweep.suspects import Suspects
from sonocal.sweep.tabulate import tabulate, tabulated
from sonocal.sweep.unnamed import named_points
from sonocal.targets import Line, Plane, Point, Target, Unplaced, require_lines

__all__ = ["Sweep", "calibrate_points", "no_candidates"]


@dataclass(frozen=True, eq=False)
class Sweep:
    """A needle or wires in a recording: `calibrate_recording` in steps, for whoever looks at what was detected.

    What can be refused without decoding an image was refused when it was made.

    Attributes:
        recording: images and poses.
        lines: the needles and wires.
        options: how to detect, choose and calibrate.
        detector: looks into the images.
        segments_mm: (N, L, 2, 3): the lines' ends in every item, in the probe marker's frame.
    """

    recording: Recording
    lines: Sequence[Line]
    options: Options
    detector: Detector
    segments_mm: Array

    __repr__ = brief

    @classmethod
    def of(cls, recording: Recording, lines: Sequence[Line], **options: Unpack[Keywords]) -> Sweep:
        """As `calibrate_recording`.

        Raises:
            InputError: the recording lacks images, nothing connects a line to the probe, or an option does not exist
                or means nothing.
        """
        require("recording", recording, Recording)
        require_lines(lines)
        asked = Options.for_lines(recording, lines, **options)
        if asked.latency is not None:
            require_clock(recording)
        detector = detector_of(recording, asked.detection)
        return cls(recording, lines, asked, detector, asked.posing.segments_mm(recording, lines))

    def detect(self, progress: Progress | None = None) -> Detections:
        """What may be the needle; as `sonocal.detection.detect`."""
        return self.detector.detect(progress)

    def calibrate(self, detections: Detections, start: AxisScaled | None = None) -> CandidateCalibration:
        """Choose among what was detected, look again, and calibrate.

        Args:
            detections: what was found.
            start: a transform that may be near, such as another's calibration of the probe: candidates are chosen
                by it, where more agree with it than with what they agree on by themselves.

        Raises:
            NoConsensusError, DegenerateGeometryError: as `calibrate_recording`.
            InputError: no detection is in a frame with valid poses, or they are of other images.
        """
        name, images = self.recording.name, detections.images
        if len(detections) == 0:
            raise no_candidates(name, images)
        if self.options.latency is not None:
            return self._late(detections, start)
        table = tabulated(self.recording, self.lines, detections, self.segments_mm).observations
        # How well an echo is placed is not told: a needle bends and sound is refracted, so that echo and needle part
        # by more. Taken for all of the image's noise, it would leave the rest to the tracker: to wrong sightings.
        table = table.with_sound(sigma_px=None)
        again = self.options.second_look
        look = SecondLook(self.detector, self.lines, self.segments_mm, detections) if again else None
        most_mm = telling_threshold_mm(self.lines)
        total, across = images * len(self.lines), self._across()
        suspects = _suspects(self.recording, self.lines, detections, self.options)
        with suspects.explaining():
            found = calibrate_chosen(
                table, self.options, total, look, most_mm=most_mm, across=across, start=start
            )
        judged = suspects.judging(found.calibration, found.agreeing, found.sightings)
        rows = seen_at_assumed_speed(judged.sound, found.observations)
        judged = with_slice_noise(judged, rows)
        wider = with_pose_errors(judged, rows, self.recording, self.options.posing)
        recorded = as_recorded(wider, self.recording, self.lines, self.options.probe)
        return replace(found, calibration=recorded)

    def candidates(self, detections: Detections) -> Observations:
        """The table of what was detected, with the velocities of lines that move.

        Raises:
            NoConsensusError: nothing was detected.
            InputError: no detection is in a frame with valid poses, or they are of other images.
        """
        if len(detections) == 0:
            raise no_candidates(self.recording.name, detections.images)
        table = tabulate(self.recording, self.lines, detections, self.options.posing).observations
        return with_line_velocities(table, self.recording, self.lines, self.options.posing)

    def at_lag(self, latency_s: float) -> Sweep:
        """The same with every pose taken where its image belongs."""
        moved = with_latency(self.recording, latency_s, on_invalid=self.options.on_invalid)
        segments = self.options.posing.segments_mm(moved, self.lines)
        known = replace(self.options, latency=None)
        return replace(self, recording=moved, segments_mm=segments, options=known)

    def _late(self, detections: Detections, start: AxisScaled | None) -> CandidateCalibration:
        """As `calibrate`, with the lag as one more unknown: what is chosen under it roughly tells it finely."""
        recording, lines, segments = self.recording, self.lines, self.segments_mm
        tried = lag_of_candidates(recording, lines, detections, segments, self.options)
        chosen = most_used([partial(self.at_lag(one).calibrate, detections, start) for one in tried])
        lag = lag_of_rows(moving_rows(recording, lines, chosen, segments), self.options, recording.name)
        found = self.at_lag(lag.latency_s).calibrate(detections, lag.fit.transform)
        rows = seen_at_assumed_speed(found.calibration.sound, found.observations)
        return replace(found, calibration=with_lag(found.calibration, lag, rows))

    def _across(self) -> Array | None:
        """(N, 2, 3): of the only needle, two axes across it that turn with it, in the probe marker's frame."""
        if len(self.lines) > 1:
            return None
        line = self.lines[0]
        along = line.segment_mm[1] - line.segment_mm[0]
        turned = np.linalg.svd(along[None])[2][1:]  # an orthonormal rest
        aside = [replace(line, name=f"aside {i}", segment_mm=line.segment_mm + turned[i]) for i in (0, 1)]
        ends = self.options.posing.segments_mm(self.recording, aside)
        return np.asarray((ends - self.segments_mm)[:, :, 0])


def no_candidates(name: str, images: int) -> NoConsensusError:
    """What to say where detection found nothing at all."""
    return NoConsensusError(
        f"{name}: no candidate was found in {images} images; nothing in them stands out as a needle does: check in "
        "the contact sheet that it is visible",
        best_count=0,
    )


def calibrate_points(
    recording: Recording,
    lines: Sequence[Target | Unplaced],
    detections: Detections,
    **options: Unpack[PointsKeywords],
) -> tuple[Calibration, Observations]:
    """Calibrate a probe from a recording and points that were found in its images by other means.

    Args:
        recording: poses, with any latency undone, and images that need not be decoded.
        lines: the needles and wires, see `read_lines`; or points, lines and planes, see `read_targets`; of these some
            may be `Unplaced`: where they are is found with the calibration.
        detections: the points, see `read_detections`; where there are several lines and no point names one, which
            is of which is told by where they lie, as by `registration.associate`.
        **options: any of those of `sonocal.calibrate`, and `probe`, `fixed` and `on_invalid` of `calibrate_recording`.

    Returns:
        The calibration, and the table of sightings that it was fitted to.

    Raises:
        InputError: a point belongs to no line or frame, some name a line and others do not, nothing connects a line to
            the probe, or an option does not exist or means nothing.
        DegenerateGeometryError, NoConsensusError: as `sonocal.calibrate`.
    """
    require("recording", recording, Recording)
    require("detections", detections, Detections)
    asked = PointsOptions.for_recording(recording, **options)
    if isinstance(lines, (tuple, list)) and any(isinstance(one, Unplaced) for one in lines):
        rows = placed_rows(recording, lines, detections, asked.posing)
        found = calibrate(rows, **of_calibrate(asked, targets=tuple(lines)))
        return found, placed_by(found, rows)
    every: Any = lines
    if not _lines_alone(every, detections):
        return calibrate_targets(recording, every, detections, asked)
    known: list[Any] = [line for line in every if not isinstance(line, (Plane, Point))]
    require_lines(known)
    detections, of_labels = named_points(recording, known, detections, asked)
    lag = None if asked.latency is None else lag_of_points(recording, known, detections, asked)
    if lag is not None:
        recording = with_latency(recording, lag.latency_s, on_invalid=asked.on_invalid)
    sightings = tabulate(recording, known, detections, asked.posing)
    suspects = _suspects(recording, known, detections, asked)
    with suspects.explaining():
        found = calibrate(sightings.observations, **of_calibrate(asked, latency=None))
    found = suspects.judging(found, found.fit.inliers, found.fit.observations).with_findings(
        [*sightings.diagnostics, *of_labels]
    )
    rows = seen_at_assumed_speed(found.sound, sightings.observations)
    found = with_pose_errors(with_slice_noise(found, rows), rows, recording, asked.posing)
    found = as_recorded(found, recording, known, asked.probe)
    return found if lag is None else with_lag(found, lag, rows), sightings.observations


def _lines_alone(targets: object, detections: Detections) -> bool:
    """Whether points are of lines alone: a needle's file may hold its tip, too."""
    require("lines", targets, Sequence, "points, lines and planes")
    assert isinstance(targets, Sequence)
    others = {one.name for one in targets if isinstance(one, (Plane, Point))}
    named = {*detections.target.tolist()} - {""}
    return not others & named and (len(others) < len(targets) or not others)


def _suspects(
    recording: Recording, lines: Sequence[Line], detections: Detections, options: PointsOptions
) -> Suspects:
    """What may be wrong, looked at within the threshold asked for, or what tells the lines apart."""
    threshold = options.threshold_mm
    within_mm = telling_threshold_mm(lines) if threshold == "auto" else float(threshold)
    trials = LineTrials(recording, tuple(lines), detections, options.posing, within_mm)
    return Suspects(trials, options)
