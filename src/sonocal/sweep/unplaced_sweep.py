"""A sweep of targets whose place nobody knows: the same steps as of known ones, between two calibrations.

The best-ranked candidates give a first calibration and first places. With those the targets are like any others:
candidates are chosen by them, and fainter ones looked for. What was chosen is calibrated once more, places unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np

from sonocal.calibration import Calibration
from sonocal.detection import Detections
from sonocal.detection.recordings import Detector, Images
from sonocal.errors import InputError, SonocalError, UnsupportedError, require
from sonocal.geometry import AxisScaled
from sonocal.geometry.shown import brief
from sonocal.recording import Recording
from sonocal.recording.health import Progress
from sonocal.sweep.calibrate import Sweep, no_candidates
from sonocal.sweep.choice import CandidateCalibration
from sonocal.sweep.first_places import first_places
from sonocal.sweep.lagged import require_clock
from sonocal.sweep.options import Keywords, Options, telling_threshold_mm
from sonocal.sweep.own_places import threshold_of, with_own_places
from sonocal.sweep.targets import TargetSweep, detected, detectors_of, looked_for
from sonocal.targets import Line, Plane, Point, Target, Unplaced, check_lines
from sonocal.targets.unplaced import kind_of

__all__ = ["UnplacedSweep"]

# A line of whichever place: what connects its frame to the probe is looked for before the first image is decoded.
ANYWHERE = np.eye(3)[:2]
CARRIED = {
    *(
        "images-used",
        "no-pose",
        "no-image",
        "second-needle",
        "second-wall",
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
"""Findings about images and recordings, which hold whatever is known of the targets."""


@dataclass(frozen=True, eq=False)
class UnplacedSweep:
    """Targets in a recording, of some of which the place in their frame is asked for; used as `TargetSweep` is.

    Attributes:
        recording: images and poses.
        targets: those that are looked for, `sonocal.targets.Unplaced` among them.
        options: how to detect, choose and calibrate.
        detectors: look into the images, one after the other: for points and lines, for planes.
    """

    recording: Recording
    targets: tuple[Target | Unplaced, ...]
    options: Options
    detectors: tuple[Images, ...]

    __repr__ = brief

    @classmethod
    def of(
        cls, recording: Recording, targets: Sequence[Target | Unplaced], /, **options: Unpack[Keywords]
    ) -> UnplacedSweep:
        """As `calibrate_recording`.

        Raises:
            InputError: the recording lacks images, or an option does not exist or means nothing.
            UnsupportedError: beads are to be found in volumes, or wires of a phantom without a place.
        """
        require("recording", recording, Recording)
        if wrong := [one for one in targets if not isinstance(one, (Line, Plane, Point, Unplaced))]:
            raise InputError(f"targets must be points, lines and planes; got {wrong[0]!r}"[:200])
        check_lines(recording.name, targets, "targets")
        if any(isinstance(one, Unplaced) and one.phantom is not None for one in targets):
            raise UnsupportedError(
                f"{recording.name}: which dot is of which wire of a phantom without a place is not found in images; "
                "name the wires with --points, or say where the phantom is"
            )
        asked = Options.for_unplaced(recording, targets, **options)
        if asked.latency is not None:
            require_clock(recording)
        known = looked_for([one for one in targets if not isinstance(one, Unplaced)])
        sought = tuple(one for one in targets if isinstance(one, Unplaced) or one in known)
        asked.posing.segments_mm(recording, [Line(one.name, one.frame, ANYWHERE) for one in sought])
        return cls(recording, sought, asked, detectors_of(recording, sought, asked))

    def detect(self, progress: Progress | None = None) -> tuple[Detections, ...]:
        """What may be one of the targets, of each detector its own."""
        return detected(self.detectors, progress)

    def calibrate(
        self, detections: Detections | Sequence[Detections], start: AxisScaled | None = None
    ) -> CandidateCalibration:
        """As `TargetSweep.calibrate`."""
        seen = [detections] if isinstance(detections, Detections) else list(detections)
        for one in seen:
            require("detections", one, Detections)
        if not any(len(one) for one in seen):
            raise no_candidates(self.recording.name, max((one.images for one in seen), default=0))
        told = self._by_told(seen, start)
        first = first_places(self.recording, self.targets, seen, self.options, told)
        telling = _telling_apart(self.options, first.targets)
        known = replace(telling, latency=None)
        chosen = self._chosen(first.recording, first.targets, seen, known, start or first.transform)
        found, rows = with_own_places(chosen.observations, self.recording, self.targets, telling)
        return replace(chosen, calibration=self._told(found, chosen.calibration), observations=rows)

    def _by_told(self, seen: Sequence[Detections], start: AxisScaled | None) -> AxisScaled | None:
        """A calibration by those targets alone whose place was told; None where they do not tell it."""
        told = tuple(one for one in self.targets if not isinstance(one, Unplaced))
        if not told or self.options.latency is not None:
            return None
        kinds = {kind_of(one) == "plane" for one in told}
        mine = [one for one in seen if (one.points_each == one.dimension) in kinds]
        with suppress(SonocalError):
            found = self._chosen(self.recording, told, mine, self.options, start)
            return found.calibration.probe_from_image
        return None

    def _chosen(
        self,
        recording: Recording,
        targets: tuple[Target, ...],
        seen: Sequence[Detections],
        options: Options,
        start: AxisScaled | None,
    ) -> CandidateCalibration:
        """Candidates chosen by where targets are."""
        lines = [one for one in targets if isinstance(one, Line)]
        if len(lines) < len(targets):
            return TargetSweep(recording, targets, options, self.detectors).calibrate(seen, start)
        detector = self.detectors[0]
        assert isinstance(detector, Detector)
        segments = options.posing.segments_mm(recording, lines)
        return Sweep(recording, lines, options, detector, segments).calibrate(seen[0], start)

    def _told(self, found: Calibration, chosen: Calibration) -> Calibration:
        """The calibration with what its recording and images say."""
        told = found.with_findings([one for one in chosen.diagnostics if one.code in CARRIED])
        return replace(told, latency_s=found.latency_s or self.recording.latency_s or None)


def _telling_apart(options: Options, targets: Sequence[Target]) -> Options:
    """The options with a threshold that tells several targets apart, now that it is known where they are."""
    if len(targets) == 1:
        return options
    return replace(options, threshold_mm=min(threshold_of(options), telling_threshold_mm(targets)))
