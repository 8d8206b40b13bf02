"""From a recording of a needle to a calibration: detection, choice, a second look, calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration, calibrate
from sonocal.detection import (
    Candidates,
    LineCandidates,
    detect_points,
    detect_volumes,
    find_mask,
)
from sonocal.detection.points import Centre, Progress
from sonocal.errors import InputError
from sonocal.observations import Observations
from sonocal.recording import (
    Recording,
    health,
)
from sonocal.recording.poses import OnInvalid
from sonocal.sweep.choice import (
    CandidateCalibration,
    calibrate_candidates,
)
from sonocal.sweep.detections import Detections
from sonocal.sweep.second_look import (
    SecondLook,
    lines_near,
    points_near,
)
from sonocal.sweep.sightings import (
    Fixed,
    candidate_observations,
    expected_observations,
    line_observations,
    observations_from_recording,
)
from sonocal.targets import Line

__all__ = [
    "calibrate_points",
    "calibrate_recording",
    "require_images",
]


IMAGE_COUNT = 5
THRESHOLD_MM, LEAST_THRESHOLD_MM = 5.0, 1.0
SPACING_SHARE = 0.2
"""Of the distance between wires: more, and wrong calibrations agree by taking one wire for the next."""
LINE_SAMPLES = 64


def calibrate_recording(
    recording: Recording,
    lines: Sequence[Line],
    *,
    count: int | None = None,
    mask: NDArray[np.bool_] | None = None,
    centre: Centre = "head",
    probe: str = "Probe",
    fixed: Fixed = None,
    latency_s: float = 0.0,
    on_invalid: OnInvalid = "raise",
    second_look: bool = True,
    progress: Progress | None = None,
    candidates: Candidates | LineCandidates | None = None,
    threshold_mm: float | None = None,
    **options: Any,
) -> CandidateCalibration:
    """Calibrate a probe from a recording of a needle or wires, with nobody clicking.

    Args:
        recording: images and poses.
        lines: the needles and wires, see `read_lines`.
        count: candidates an image; default: 5, and 3 in a volume.
        mask: where to look; default: found from the recording.
        centre: "head" or "mass", see `PointDetector`.
        probe: the tool that the probe's marker is called.
        fixed: constant ``(target, source) -> (4, 4)``, such as a device set's.
        latency_s: how much later the tracker stamps an instant than the images do.
        on_invalid: what to do with poses marked valid that are not rigid.
        second_look: look again near where the calibrated needle must be.
        progress: called with how many images are done and how many there are.
        candidates: what `detect_points` or, in volumes, `detect_volumes` found, where that was done before.
        threshold_mm: candidates further than this from their needle are wrong; default: 5, or a fifth of the
            distance between lines of one frame, so that they are not taken for one another.
        options: of `sonocal.calibrate`.

    Raises:
        NoConsensusError: nothing in the images moves like the needle.
        InputError: the recording lacks images or poses.
    """
    require_images(recording)
    assert recording.image is not None
    options.setdefault("image_size_px", recording.image.size_px)
    threshold_mm = _telling_threshold(lines) if threshold_mm is None else threshold_mm
    how: dict[str, Any] = {
        "probe": probe,
        "fixed": fixed,
        "latency_s": latency_s,
        "on_invalid": on_invalid,
    }
    if recording.image.dimension == 3:
        if not isinstance(candidates, LineCandidates):
            chosen_count = {} if count is None else {"count": count}
            candidates = detect_volumes(recording, progress=progress, **chosen_count)
        table = line_observations(recording, lines, candidates, **how)
        find = lines_near(recording)
    else:
        mask = find_mask(recording.frames, name=recording.name) if mask is None else mask
        if not isinstance(candidates, Candidates):
            candidates = detect_points(
                recording, count=count or IMAGE_COUNT, mask=mask, centre=centre, progress=progress
            )
        table = candidate_observations(recording, lines, candidates, **how)
        find = points_near(recording, mask, centre)
    found = calibrate_candidates(
        _levels_estimated(table),
        sightings=candidates.frames * len(lines),
        look_again=SecondLook(expected_observations(recording, lines, **how), find) if second_look else None,
        threshold_mm=threshold_mm,
        **options,
    )
    return replace(found, calibration=_as_recorded(found.calibration, recording, lines, probe, latency_s))


def require_images(recording: Recording) -> None:
    """Refuses a recording without images.

    Raises:
        InputError: it has none.
    """
    if recording.image is None or len(recording.frames) == 0:
        raise InputError(f"{recording.name}: has no images to look for a needle in; record images too")


def calibrate_points(
    recording: Recording,
    lines: Sequence[Line],
    detections: Detections,
    *,
    probe: str = "Probe",
    fixed: Fixed = None,
    latency_s: float = 0.0,
    on_invalid: OnInvalid = "raise",
    **options: Any,
) -> tuple[Calibration, Observations]:
    """Calibrate a probe from a recording and points that were found in its images by other means.

    Args:
        recording: poses, and images that need not be decoded.
        lines: the needles and wires, see `read_lines`.
        detections: the points, see `read_detections`.
        probe: the tool that the probe's marker is called.
        fixed: constant ``(target, source) -> (4, 4)``, such as a device set's.
        latency_s: how much later the tracker stamps an instant than the images do.
        on_invalid: what to do with poses marked valid that are not rigid.
        options: of `sonocal.calibrate`.

    Returns:
        The calibration, and the table of sightings that it was fitted to.

    Raises:
        InputError: a point belongs to no line or frame, or nothing connects a line to the probe.
        DegenerateGeometryError, NoConsensusError: as `sonocal.calibrate`.
    """
    sightings = observations_from_recording(
        recording, lines, detections, probe=probe, fixed=fixed, latency_s=latency_s, on_invalid=on_invalid
    )
    if recording.image is not None:
        options.setdefault("image_size_px", recording.image.size_px)
    found = calibrate(sightings.observations, **options)
    found = replace(found, diagnostics=(*found.diagnostics, *sightings.diagnostics))
    return _as_recorded(found, recording, lines, probe, latency_s), sightings.observations


def _as_recorded(
    calibration: Calibration,
    recording: Recording,
    lines: Sequence[Line],
    probe: str,
    latency_s: float,
) -> Calibration:
    """The calibration with the latency it was made with, and with what is wrong with the recording.

    Of the recording's tools, those that took part.
    """
    tools = {probe.lower(), *(line.frame.lower() for line in lines)}
    poses = {name: one for name, one in recording.poses.items() if one.source.lower() in tools}
    noticed = health(replace(recording, poses=poses), look_at_images=False)
    worth = [one for one in noticed if one.severity == "warning" or one in recording.diagnostics]
    merged = sorted([*calibration.diagnostics, *worth], key=lambda one: one.severity != "warning")
    return replace(calibration, diagnostics=tuple(merged), latency_s=latency_s or calibration.latency_s)


def _telling_threshold(lines: Sequence[Line]) -> float:
    """Millimetres within which a candidate belongs to one line and not to its neighbour."""
    steps = np.linspace(0.0, 1.0, LINE_SAMPLES)[:, None]
    sampled = [line.segment_mm[0] + steps * (line.segment_mm[1] - line.segment_mm[0]) for line in lines]
    apart = [
        float(np.linalg.norm(sampled[i][:, None] - sampled[j], axis=-1).min())
        for i in range(len(lines))
        for j in range(i)
        if lines[i].frame == lines[j].frame
    ]
    return float(np.clip(SPACING_SHARE * min(apart, default=np.inf), LEAST_THRESHOLD_MM, THRESHOLD_MM))


def _levels_estimated(candidates: Observations) -> Observations:
    """The candidates without how well their echoes were placed: echo and needle part by more than that.

    A needle bends and sound is refracted. Taken for all of the image's noise, the detector's share would leave the
    rest to the tracker, and so to the wrong sightings.
    """
    return replace(candidates, sigma_px=None)
