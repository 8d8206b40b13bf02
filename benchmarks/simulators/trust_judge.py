"""What the program says of a case whose truth is known, and how far off it is."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
from scipy.spatial.transform import Rotation

import sonocal as sc
from benchmarks.simulators.trust_faults import Case
from benchmarks.simulators.trust_scans import Array, Scan, mapped
from sonocal.calibration import Calibration
from sonocal.detection import Detections
from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording
from sonocal.targets import Line
from sonocal.validation.verdict import give_verdict

CONFIDENTLY = 3.0
# These say that the predicted error is larger than what is accepted, 2 mm: true of a sound scan of few rows.
HONEST = {"weak-motion", "predicted-error-beyond-tolerance"}
NEEDLE = Line("needle", "Needle", np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -250.0]]))


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a case.

    Attributes:
        level: "refused", "stop", "care" or "use".
        codes: of the refusal or of the verdict's reasons, worst first; an exception's name where it has none.
        error_mm, bound_mm: at the corner of the image where the error is the most times the bound; NaN where refused.
        lag_ms: the latency named, or NaN.
        covered: the share of the corners whose error is within the bound there, or NaN.
    """

    level: str
    codes: tuple[str, ...]
    error_mm: float = np.nan
    bound_mm: float = np.nan
    lag_ms: float = np.nan
    covered: float = np.nan

    @property
    def accused(self) -> bool:
        """Something else was said against it than how large the error may be."""
        return self.level == "refused" or bool(set(self.codes) - HONEST)

    @property
    def silent(self) -> bool:
        """Nothing was said against it."""
        return self.level == "use"

    @property
    def off(self) -> bool:
        """The error is beyond the bound."""
        return bool(self.error_mm > self.bound_mm)

    @property
    def confidently_wrong(self) -> bool:
        """Silent, and off by three times the bound."""
        return self.silent and bool(self.error_mm > CONFIDENTLY * self.bound_mm)


def table(scan: Scan) -> sc.Observations:
    """The scan as a table of sightings."""
    each = scan.points_px.shape[1]
    frame = np.arange(len(scan.time_s)) if scan.frame is None else scan.frame
    stamps = {} if scan.still else {"time_s": np.repeat(scan.time_s, each).round(6).astype(str)}
    return sc.Observations(
        scan.points_px.reshape(-1, scan.dimension),
        np.repeat(scan.segments_mm(), each, axis=0),
        frame=np.repeat(frame, each),
        target=None if scan.target is None else np.repeat(scan.target, each),
        extra=stamps,
        source="table",
    )


def needle_poses(ends_mm: Array) -> Array:
    """(N, 4, 4): the pose of a needle that lies along the ends (N, 2, 3), rolled so as to turn least."""
    back = ends_mm[:, 0] - ends_mm[:, 1]
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    axis = np.cross([0.0, 0.0, 1.0], back)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine, back[:, 2:])
    poses = np.tile(np.eye(4), (len(back), 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(axis / np.maximum(sine, 1e-12) * angle).as_matrix()
    poses[:, :3, 3] = ends_mm[:, 0]
    return poses


def recording(scan: Scan) -> Recording:
    """The scan as a recording whose images were looked at before."""
    count, size = len(scan.time_s), image_size(scan)
    poses = (
        Poses.of("Probe", "Tracker", scan.tracker_from_probe),
        Poses.of("Needle", "Tracker", needle_poses(scan.ends_mm)),
    )
    return Recording(
        times=scan.time_s,
        poses={one.name: one for one in poses},
        frames=ArrayFrames(np.broadcast_to(np.uint8(0), (count, *size[::-1]))),
        image=ImageGeometry(size, 1, "uint8", "MF", np.eye(4)),
    )


def candidates(case: Case) -> Detections:
    """What a detector found: the scan's points, and fainter ones."""
    count = len(case.scan.time_s)
    sets = [case.scan.points_px] if case.second is None else [case.scan.points_px, case.second]
    points = np.stack(sets, axis=1).reshape(-1, *case.scan.points_px.shape[1:])
    return Detections(np.repeat(np.arange(count), len(sets)), points, images=count, source="recording")


def image_size(scan: Scan) -> tuple[int, ...]:
    """The image's size, px as given."""
    return tuple(round(side) + 1 for side in scan.corners_px.max(axis=0))


def calibrated(case: Case) -> Calibration:
    """The program under test."""
    if case.recording:
        found = candidates(case)
        return sc.calibrate_recording(
            recording(case.scan), [NEEDLE], detections=found, second_look=False
        ).calibration
    size = image_size(case.scan) if case.size_known else None
    return sc.calibrate(table(case.scan), image_size_px=size)


def judged(case: Case) -> Outcome:
    """What the program says of the case, beside the truth."""
    frame_ms = 1e3 * float(np.median(np.diff(case.scan.time_s)))
    try:
        found = calibrated(case)
        verdict = give_verdict(found)
    except sc.SonocalError as refusal:
        code = getattr(refusal, "code", None) or type(refusal).__name__
        return Outcome("refused", (str(code),), lag_ms=lag_named(code, str(refusal), frame_ms))
    lags = [lag_named(finding.code, finding.message, frame_ms) for finding in found.warnings]
    errors, bounds = at_corners(found, case.scan)
    worst = int(np.argmax(errors / bounds)) if np.isfinite(bounds).all() else int(np.argmax(errors))
    lag = next((x for x in lags if np.isfinite(x)), np.nan)
    covered = float(np.mean(errors <= bounds))
    return Outcome(verdict.level, verdict.codes, float(errors[worst]), float(bounds[worst]), lag, covered)


def lag_named(code: str | None, sentence: str, frame_ms: float) -> float:
    """The latency, ms, that a sentence about it names first; NaN where it is about something else."""
    told = re.search(r"(-?\d+(?:\.\d+)?) (ms|frames)", sentence)
    if told is None or not (code == "latency" or "laten" in sentence):
        return np.nan
    return float(told[1]) * (frame_ms if told[2] == "frames" else 1.0)


def at_corners(found: Calibration, scan: Scan) -> tuple[Array, Array]:
    """Error and predicted 95 % bound (M,), mm, at the corners of the image."""
    corners = scan.corners_px
    errors = np.linalg.norm(found.probe_from_image @ corners - mapped(scan.truth, corners), axis=1)
    if found.covariance is None:
        return errors, np.full(len(corners), np.inf)
    area = np.stack([corners.min(axis=0), corners.max(axis=0)])
    places, _, bounds = dataclasses.replace(found, area_px=area).predicted_errors()
    order = [int(np.argmin(np.linalg.norm(places - corner, axis=1))) for corner in corners]
    return errors, bounds[order]


__all__ = ["HONEST", "Outcome", "judged", "recording", "table"]
