"""From a recording of a needle to a calibration: detection, the table of candidates, choice, a second look.

A needle's point takes these forms on its way: the core's array of blobs (or a volume's lines); points, covariances and
scores of one image; `Detections` of the recording; `Observations`, the table against lines in the probe marker's
frame; `PointLineRows`, as the core takes it; and the CSV file of the rows that were chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from sonocal.calibration import Calibration, calibrate
from sonocal.detection import Detections
from sonocal.detection.recordings import Detector, detector_of
from sonocal.errors import InputError, NoConsensusError
from sonocal.observations import Observations
from sonocal.recording import Recording, health
from sonocal.recording.health import Progress
from sonocal.sweep.choice import CandidateCalibration, calibrate_chosen
from sonocal.sweep.options import Options, PointsOptions, of_calibrate, telling_threshold_mm
from sonocal.sweep.second_look import SecondLook
from sonocal.sweep.tabulate import tabulate
from sonocal.targets import Line

__all__ = ["calibrate_detections", "calibrate_points", "calibrate_recording", "no_candidates"]


def calibrate_recording(
    recording: Recording,
    lines: Sequence[Line],
    *,
    detections: Detections | None = None,
    progress: Progress | None = None,
    **keywords: Any,
) -> CandidateCalibration:
    """Calibrate a probe from a recording of a needle or wires, with nobody clicking.

    Args:
        recording: images, and poses with any latency undone, see `with_latency`.
        lines: the needles and wires, see `read_lines`.
        detections: what `detect` found, where that was done before.
        progress: called with how many images are done and how many there are.
        keywords: options of `sonocal.sweep.Options`: of detection (count, mask, centre), of what connects the lines to
            the probe (probe, fixed, on_invalid), of choosing (threshold_mm, second_look) and of `sonocal.calibrate`.

    Raises:
        NoConsensusError: nothing in the images moves like the needle.
        DegenerateGeometryError: the sightings leave a motion free.
        InputError: the recording lacks images or poses, or an option does not exist or means nothing.
    """
    options = Options.for_lines(recording, lines, **keywords)
    detector = detector_of(recording, options.detection)
    options.posing.segments_mm(recording, lines)  # refused before images are decoded
    found = detector.detect(progress) if detections is None else detections
    return calibrate_detections(detector, lines, found, options)


def calibrate_detections(
    detector: Detector, lines: Sequence[Line], detections: Detections, options: Options
) -> CandidateCalibration:
    """As `calibrate_recording`, from what a detector has found already.

    Args:
        detector: of the recording's images, for a second look.
        lines: the needles and wires.
        detections: several an image, of which at most one a line is right.
        options: how to choose and calibrate.
    """
    recording = detector.recording
    if len(detections) == 0:
        raise no_candidates(recording.name, detections.images)
    # How well an echo is placed is not told: a needle bends and sound is refracted, so that echo and needle part by
    # more. Taken for all of the image's noise, it would leave the rest to the tracker, and so to the wrong sightings.
    table = tabulate(recording, lines, detections, options.posing).observations.with_sound(sigma_px=None)
    look = SecondLook(detector, lines, options.posing, detections) if options.second_look else None
    sightings, most_mm = detections.images * len(lines), telling_threshold_mm(lines)
    chosen = calibrate_chosen(table, options, sightings, look, most_mm)
    return replace(chosen, calibration=_as_recorded(chosen.calibration, recording, lines, options.probe))


def no_candidates(name: str, images: int) -> NoConsensusError:
    """What to say where detection found nothing at all."""
    return NoConsensusError(
        f"{name}: no candidate was found in {images} images; nothing in them stands out as a needle does: check in "
        "the contact sheet that it is visible",
        best_count=0,
    )


def calibrate_points(
    recording: Recording, lines: Sequence[Line], detections: Detections, **keywords: Any
) -> tuple[Calibration, Observations]:
    """Calibrate a probe from a recording and points that were found in its images by other means.

    Args:
        recording: poses, with any latency undone, and images that need not be decoded.
        lines: the needles and wires, see `read_lines`.
        detections: the points, see `read_detections`.
        keywords: options of `sonocal.sweep.PointsOptions`: of what connects the lines to the probe (probe, fixed,
            on_invalid) and of `sonocal.calibrate`.

    Returns:
        The calibration, and the table of sightings that it was fitted to.

    Raises:
        InputError: a point belongs to no line or frame, nothing connects a line to the probe, or an option does not
            exist or means nothing.
        DegenerateGeometryError, NoConsensusError: as `sonocal.calibrate`.
    """
    options = PointsOptions.for_recording(recording, **keywords)
    if len(lines) > 1 and (detections.target == "").any():
        raise InputError(
            f"{detections.source}: target '' is none of the lines {', '.join(line.name for line in lines)[:200]}; "
            "name one"
        )
    sightings = tabulate(recording, lines, detections, options.posing)
    found = calibrate(sightings.observations, **of_calibrate(options))
    found = replace(found, diagnostics=(*found.diagnostics, *sightings.diagnostics))
    return _as_recorded(found, recording, lines, options.probe), sightings.observations


def _as_recorded(
    calibration: Calibration, recording: Recording, lines: Sequence[Line], probe: str
) -> Calibration:
    """The calibration with the latency of its recording, and with what is wrong with that.

    Of the recording's tools, those that took part.
    """
    tools = {probe.lower(), *(line.frame.lower() for line in lines)}
    poses = {name: one for name, one in recording.poses.items() if one.source.lower() in tools}
    noticed = health(replace(recording, poses=poses), look_at_images=False)
    worth = [one for one in noticed if one.severity == "warning" or one in recording.diagnostics]
    merged = sorted([*calibration.diagnostics, *worth], key=lambda one: one.severity != "warning")
    return replace(calibration, diagnostics=tuple(merged), latency_s=recording.latency_s or None)
