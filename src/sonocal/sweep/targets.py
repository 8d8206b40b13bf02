"""From a recording of walls, cross-wires and threads to a calibration, with nobody clicking."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Unpack

import numpy as np

from sonocal.detection import Detections
from sonocal.detection.recordings import Images, detector_of, require_images
from sonocal.detection.wall_recordings import RecordedWalls
from sonocal.errors import NoConsensusError, UnsupportedError, require
from sonocal.findings import Diagnostic
from sonocal.geometry import AxisScaled
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.recording import Recording
from sonocal.recording.health import Progress
from sonocal.sweep.candidates import Candidates
from sonocal.sweep.choice import CandidateCalibration, calibrate_chosen
from sonocal.sweep.mixed import spanning_mm
from sonocal.sweep.options import Keywords, Options
from sonocal.sweep.recorded import as_recorded
from sonocal.sweep.second_wall import find_second_wall, second_wall_findings
from sonocal.sweep.tabulate_targets import tabulate_candidates
from sonocal.sweep.target_candidates import TargetCandidates
from sonocal.targets import Line, Point, Target, Unplaced, check_lines
from sonocal.targets.unplaced import kind_of

__all__ = ["TargetSweep", "detected", "detectors_of", "looked_for"]

ON_LINE_MM = 1.0
"""A point so near a line of its own frame is an end of the needle, and not another target."""


def looked_for(targets: Sequence[Target]) -> tuple[Target, ...]:
    """The targets that images are searched for: all but points on a line of the same frame, which are needles' tips."""
    lines = [one for one in targets if isinstance(one, Line)]
    return tuple(
        one for one in targets if not (isinstance(one, Point) and any(_is_end(one, line) for line in lines))
    )


def _is_end(point: Point, line: Line) -> bool:
    if point.frame.lower() != line.frame.lower():
        return False
    along = (line.segment_mm[1] - line.segment_mm[0]) / np.linalg.norm(
        line.segment_mm[1] - line.segment_mm[0]
    )
    off = np.linalg.norm(np.cross(point.place_mm - line.segment_mm[0], along))
    return bool(off <= ON_LINE_MM) and bool(
        np.linalg.norm(point.place_mm - line.segment_mm, axis=1).min() <= ON_LINE_MM
    )


@dataclass(frozen=True, eq=False)
class TargetSweep:
    """Points, lines and planes in a recording: `calibrate_recording` in steps, for whoever looks at what was detected.

    What can be refused without decoding an image was refused when it was made.

    Attributes:
        recording: images and poses.
        targets: those that are looked for.
        options: how to detect, choose and calibrate.
        detectors: look into the images, one after the other: for points and lines, for planes.
    """

    recording: Recording
    targets: tuple[Target, ...]
    options: Options
    detectors: tuple[Images, ...]

    __repr__ = brief

    @classmethod
    def of(
        cls, recording: Recording, targets: Sequence[Target], /, **options: Unpack[Keywords]
    ) -> TargetSweep:
        """As `calibrate_recording`.

        Raises:
            InputError: the recording lacks images, nothing connects a target to the probe, or an option does not exist
                or means nothing.
            UnsupportedError: an option is for lines alone, or beads are to be found in volumes.
        """
        require("recording", recording, Recording)
        known = looked_for(targets)
        check_lines(recording.name, known, "targets")
        asked = Options.for_targets(recording, known, **options)
        spanning_mm(recording, known, asked.posing)  # which says what connects none of them to the probe
        return cls(recording, known, asked, detectors_of(recording, known, asked))

    def detect(self, progress: Progress | None = None) -> tuple[Detections, ...]:
        """What may be one of the targets, of each detector its own."""
        return detected(self.detectors, progress)

    def candidates(self, detections: Sequence[Detections]) -> Observations:
        """The table of what was detected.

        Raises:
            NoConsensusError: nothing was detected.
            InputError: no detection is in a frame with valid poses, or they are of other images.
        """
        for one in detections:
            require("detections", one, Detections)
        if not any(len(one) for one in detections):
            raise self._nothing_seen(detections)
        return tabulate_candidates(self.recording, self.targets, detections, self.options.posing)

    def calibrate(
        self, detections: Sequence[Detections], start: AxisScaled | None = None
    ) -> CandidateCalibration:
        """Choose among what was detected, and calibrate.

        Args:
            detections: what was found.
            start: a transform that may be near, such as another's calibration of the probe.

        Raises:
            NoConsensusError, DegenerateGeometryError: as `calibrate_recording`.
            InputError: no detection is in a frame with valid poses, or they are of other images.
        """
        table = self.candidates(detections)
        # As with needles, how well an echo is placed is not how far off what is scanned may be.
        table = table.with_sound(sigma_px=None)
        kind = Candidates if table.lines_only else TargetCandidates
        images = max(one.images for one in detections)
        found = calibrate_chosen(table, self.options, images, start=start, kind=kind)
        known = found.calibration.with_findings(self._of_walls(detections, found))
        calibration = as_recorded(known, self.recording, self.targets, self.options.probe)
        return replace(found, calibration=calibration)

    def _of_walls(self, detections: Sequence[Detections], found: CandidateCalibration) -> list[Diagnostic]:
        """What runs along the chosen walls."""
        scale = float(found.calibration.probe_from_image.scales.mean())
        axes = require_images(self.recording).dimension
        walls = [one for one in detections if one.points_each == axes and one.score is not None]
        return [
            finding
            for one in walls
            for finding in second_wall_findings(find_second_wall(one, found.observations, scale))
        ]

    def _nothing_seen(self, detections: Sequence[Detections]) -> NoConsensusError:
        images = max((one.images for one in detections), default=0)
        reasons: Counter[str] = sum(
            (one.reasons for one in self.detectors if isinstance(one, RecordedWalls)), Counter()
        )
        why = "; ".join(f"in {count} of them {reason}" for reason, count in reasons.most_common(2))
        return NoConsensusError(
            f"{self.recording.name}: no candidate was found in {images} images"
            + (f" ({why})" if why else "")
            + "; nothing in them stands out as a target does: check in the contact sheet that it is visible",
            best_count=0,
        )


def detectors_of(
    recording: Recording, targets: Sequence[Target | Unplaced], options: Options
) -> tuple[Images, ...]:
    """What looks for targets of some kinds: for points and lines, then for planes.

    Raises:
        UnsupportedError: beads are to be found in volumes.
    """
    flat = require_images(recording).dimension == 2
    kinds = {kind_of(one) for one in targets}
    if not flat and "point" in kinds:
        raise UnsupportedError(
            f"{recording.name}: has volumes, in which beads and crossings are not looked for; take the [[point]] "
            "tables out of the file of targets, or give the points with --points"
        )
    found: list[Images] = []
    if kinds - {"plane"}:
        found.append(detector_of(recording, options.detection))
    if "plane" in kinds:
        found.append(RecordedWalls(recording, options.detection))
    return tuple(found)


def detected(detectors: Sequence[Images], progress: Progress | None) -> tuple[Detections, ...]:
    """What each of several detectors finds."""
    told = [_part(progress, i, len(detectors)) for i in range(len(detectors))]
    return tuple(one.detect(tell) for one, tell in zip(detectors, told, strict=True))


def _part(progress: Progress | None, which: int, count: int) -> Progress | None:
    """What one of several detectors tells of its progress, as a part of the whole."""
    if progress is None:
        return None

    def tell(tell_all: Progress, done: int, total: int) -> None:
        tell_all(which * total + done, count * total)

    return partial(tell, progress)
