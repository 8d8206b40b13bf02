"""What the program says of a scan of beads, wires and walls, beside the truth."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

import sonocal as sc
from benchmarks.simulators.mixed_scans import MixedScan
from benchmarks.simulators.trust_judge import Outcome
from benchmarks.simulators.trust_scans import mapped
from sonocal.validation.verdict import give_verdict

ROUGHLY_DEG = 10.0


def table(scan: MixedScan) -> sc.Observations:
    """The scan as a table of sightings."""
    size = tuple(round(side) + 1 for side in scan.corners_px.max(axis=0))
    return sc.Observations.of_targets(
        scan.points_px,
        scan.spanning_probe(),
        frame=scan.frame,
        target=scan.target,
        extra={"time_s": scan.time_s.round(6).astype(str)},
        image_size_px=size,
        source="table",
    )


def judged(scan: MixedScan, *, expected: bool = False) -> Outcome:
    """What the program says of the scan.

    Args:
        scan: with its truth.
        expected: the program is told how the marker is mounted to the image as it should be, to some degrees.
    """
    options = {}
    if expected:
        u, v = (scan.truth[:3, axis] / np.linalg.norm(scan.truth[:3, axis]) for axis in (0, 1))
        if np.linalg.det(scan.truth[:3, :3]) < 0:
            v = -v
        tilt = Rotation.from_rotvec(np.radians(ROUGHLY_DEG) * np.array([0.6, 0.0, 0.8])).as_matrix()
        options["expected_rotation"] = np.column_stack([u, v, np.cross(u, v)]) @ tilt
    try:
        found = sc.calibrate(table(scan), **options)
        verdict = give_verdict(found)
    except sc.SonocalError as refusal:
        return Outcome("refused", (str(getattr(refusal, "code", None) or type(refusal).__name__),))
    errors = np.linalg.norm(
        found.probe_from_image @ scan.corners_px - mapped(scan.truth, scan.corners_px), axis=1
    )
    if found.covariance is None:
        return Outcome(verdict.level, verdict.codes, float(errors.max()), np.inf)
    area = np.stack([scan.corners_px.min(axis=0), scan.corners_px.max(axis=0)])
    places, _, bounds = dataclasses.replace(found, area_px=area).predicted_errors()
    order = [int(np.argmin(np.linalg.norm(places - corner, axis=1))) for corner in scan.corners_px]
    bounds = bounds[order]
    worst = int(np.argmax(errors / bounds))
    covered = float(np.mean(errors <= bounds))
    return Outcome(verdict.level, verdict.codes, float(errors[worst]), float(bounds[worst]), np.nan, covered)


__all__ = ["judged", "table"]
