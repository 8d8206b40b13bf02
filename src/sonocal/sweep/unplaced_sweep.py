"""A sweep of a line whose place nobody knows: the same steps as of one that is known, between two calibrations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np

from sonocal.calibration import Calibration
from sonocal.detection import Detections
from sonocal.detection.recordings import Detector, detector_of
from sonocal.errors import require
from sonocal.geometry import AxisScaled
from sonocal.geometry.shown import brief
from sonocal.recording import Recording
from sonocal.recording.health import Progress
from sonocal.sweep.calibrate import Sweep, no_candidates
from sonocal.sweep.choice import CandidateCalibration
from sonocal.sweep.first_places import at_latency, first_places
from sonocal.sweep.lagged import require_clock
from sonocal.sweep.options import Keywords, Options
from sonocal.sweep.placed import require_findable, with_own_places
from sonocal.targets import Line, Unplaced

__all__ = ["UnplacedSweep"]

# A line of whichever place: what connects its frame to the probe is looked for before the first image is decoded.
ANYWHERE = np.eye(3)[:2]
CARRIED = {
    *(
        "images-used",
        "no-pose",
        "no-image",
        "second-needle",
        "no-times",
        "stamps-out-of-order",
        "stamps-repeated",
    ),
    *(
        "gaps",
        "invalid-poses",
        "non-rigid-poses",
        "static-tool",
        "frozen-poses",
        "invalid-images",
        "frozen-images",
    ),
    *("duplicated-images", "orientation-unknown", "orientation-changed", "scale-differs-from-scanner"),
}
"""Findings about images and recordings, which hold whatever is known of the line."""


@dataclass(frozen=True, eq=False)
class UnplacedSweep:
    """A line in a recording, whose place in its frame is asked for; used as `Sweep` is.

    Attributes:
        recording: images and poses.
        lines: the line, `sonocal.targets.Unplaced`.
        options: how to detect, choose and calibrate.
        detector: looks into the images.
    """

    recording: Recording
    lines: Sequence[Line | Unplaced]
    options: Options
    detector: Detector

    __repr__ = brief

    @classmethod
    def of(
        cls, recording: Recording, lines: Sequence[Line | Unplaced], **options: Unpack[Keywords]
    ) -> UnplacedSweep:
        """As `calibrate_recording`.

        Raises:
            InputError: the recording lacks images, or an option does not exist or means nothing.
            UnsupportedError: what is asked for is no single line.
        """
        require("recording", recording, Recording)
        require_findable(lines)
        asked = Options.for_lines(recording, (), **options)
        if asked.latency is not None:
            require_clock(recording)
        asked.posing.segments_mm(recording, [Line(one.name, one.frame, ANYWHERE) for one in lines])
        return cls(recording, lines, asked, detector_of(recording, asked.detection))

    def detect(self, progress: Progress | None = None) -> Detections:
        """What may be the line; as `Sweep.detect`."""
        return self.detector.detect(progress)

    def calibrate(self, detections: Detections, start: AxisScaled | None = None) -> CandidateCalibration:
        """As `Sweep.calibrate`."""
        if len(detections) == 0:
            raise no_candidates(self.recording.name, detections.images)
        first = first_places(self.recording, self.lines, detections, self.options)
        recording = at_latency(self.recording, first, self.options)
        known = replace(self.options, latency=None)
        segments = known.posing.segments_mm(recording, first.lines)
        sweep = Sweep(recording, first.lines, known, self.detector, segments)
        near = first.calibration.probe_from_image if start is None else start
        chosen = sweep.calibrate(detections, near)
        found, rows = with_own_places(chosen.observations, self.recording, self.lines, self.options)
        return replace(chosen, calibration=self._told(found, chosen.calibration), observations=rows)

    def _told(self, found: Calibration, chosen: Calibration) -> Calibration:
        """The calibration with what its recording and images say."""
        told = found.with_findings([one for one in chosen.diagnostics if one.code in CARRIED])
        return replace(told, latency_s=found.latency_s or self.recording.latency_s or None)
