"""Is the image the right way round, the line in the right frame and at the right end?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.registration.best_fit import best_fit
from sonocal.registration.fit import Fit
from sonocal.registration.mapped import MappedRows
from sonocal.registration.mirrored import mirrored_finding
from sonocal.registration.options import Model, Options
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows
from sonocal.setup_checks.evidence import Evidence

__all__ = [
    "check_flip",
    "check_needle_end",
    "check_tool_frame",
    "quick_fit",
    "wrong_frame",
]

# Known orientations are rough: an image counts as flipped when it is nearer than this to a flipped one.
ORIENTATION_RAD = np.radians(45.0)
FLIPS = {
    "left and right are exchanged": np.diag([-1.0, 1.0, -1.0]),
    "top and bottom are exchanged": np.diag([1.0, -1.0, -1.0]),
    "it is turned by half a turn": np.diag([-1.0, -1.0, 1.0]),
}
# The mirrored model must leave this much less of the squares: sound scans leave it far more.
MIRRORED_BETTER = 0.5
# Or bring the middle row this much closer, where outliers spoil the squares.
FAR_CLOSER = 0.25
# What rows agree within unless somebody says otherwise.
USUAL_MM = 5.0
BEYOND_END_MM = 5.0
# Rows in no common frame agree by chance only; other frames are believed when they agree by much more.
POOR_SHARE, GOOD_SHARE, GAIN = 0.5, 0.6, 0.25
FEW_SAMPLES = 1000
WHICH_FRAME = (
    "check which tool's transform carried the lines, which way it goes, and that rows and poses are of the same "
    "instant"
)


def check_flip(
    evidence: Evidence, *, expected_rotation: ArrayLike | None = None, marker_above_image: bool = False
) -> Iterator[Diagnostic]:
    """Is the image the right way round?

    A volume that is mirrored fits no similarity, but fits one after being mirrored back. A mirrored 2D image fits
    as well as the right one, because the plane can be turned over: only knowledge from outside tells.

    Args:
        evidence: the calibration and its rows.
        expected_rotation: (3, 3): roughly, the directions of u, v and their normal in the marker's frame, as columns,
            such as the rotation of an earlier calibration of this probe and marker.
        marker_above_image: the marker is fixed to the probe's handle, so it must lie beyond the image's upper
            half (v small), not below.
    """
    if evidence.table.dimension == 3:
        yield from _check_mirrored_volume(evidence)
    if expected_rotation is not None:
        yield from _check_orientation(evidence, np.asarray(expected_rotation, dtype=float))
    elif marker_above_image:
        yield from _check_marker_side(evidence)


def _check_mirrored_volume(evidence: Evidence) -> Iterator[Diagnostic]:
    other = _mirrored_fit(evidence)
    if other is None:
        return
    agree, others = int(evidence.inlier.sum()), int(other.inlier.sum())
    rms_mm = float(np.sqrt(np.mean(other.residuals_mm[other.inlier] ** 2)))
    otherwise = f"{agree} as they stand, with {rms_mm:.2f} instead of {evidence.rms_mm:.2f} mm rms"
    yield mirrored_finding(others, len(other.inlier), otherwise)


def _mirrored_fit(evidence: Evidence) -> Fit | None:
    """The fit of the mirrored volume, if it is the better one."""
    mirrored, agree = evidence.table.mirrored(), int(evidence.inlier.sum())
    # A threshold that was to be found from rows of a mirrored volume is as wide as the volume.
    for within_mm in sorted({evidence.threshold_mm, min(evidence.threshold_mm, USUAL_MM)}):
        other = quick_fit(mirrored, within_mm)
        if other is None:
            continue
        others, closer = int(other.inlier.sum()), _middle(other.residuals_mm, evidence.mapped.distances)
        rms_mm = float(np.sqrt(np.mean(other.residuals_mm[other.inlier] ** 2)))
        better = others >= agree and rms_mm**2 < MIRRORED_BETTER * evidence.rms_mm**2
        if others > (1 + GAIN) * agree or better or closer < FAR_CLOSER:
            return other
    return None


def _middle(distances: Array, others: Array) -> float:
    """The median of all distances, outliers included, against that of others."""
    return float(np.median(distances) / max(np.median(others), np.finfo(float).tiny))


def _check_orientation(evidence: Evidence, expected: Array) -> Iterator[Diagnostic]:
    if expected.shape != (3, 3):
        raise InputError(
            f"expected_rotation must be the directions of u, v and normal, shape (3, 3); got {expected.shape}"
        )
    turn = expected.T @ evidence.transform.rotation
    for what, flip in FLIPS.items():
        cosine = (np.trace(flip.T @ turn) - 1.0) / 2.0
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        if angle < ORIENTATION_RAD:
            yield _flipped(f"against its expected orientation {what} ({np.degrees(angle):.0f} deg off that)")
            return
    angle = np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0))
    if angle > ORIENTATION_RAD:
        yield _turned(float(np.degrees(angle)))


def _check_marker_side(evidence: Evidence) -> Iterator[Diagnostic]:
    transform = evidence.transform
    marker = -transform.translation @ transform.rotation / transform.scales
    middle = float(evidence.area_px[:, 1].mean())
    if marker[1] > middle:
        yield _flipped(
            f"the marker, which is on the handle, would lie below the image's middle, at v = {marker[1]:.0f} px"
        )


def _turned(degrees: float) -> Diagnostic:
    """By no flip: then it is as likely that what was expected is read in other axes, or is another probe's."""
    return Diagnostic(
        code="unexpected-orientation",
        severity="warning",
        message=f"the expected orientation is {degrees:.0f} deg from this one, which is no mirrored or turned image",
        advice=(
            "see what was expected: a matrix that is an inverse or in LPS axes (sonocal validate MATRIX with this scan "
            "says which), another probe's, or one from before the marker was mounted otherwise"
        ),
    )


def _flipped(how: str) -> Diagnostic:
    return Diagnostic(
        code="flipped-image",
        severity="warning",
        message=f"the image is flipped: {how}",
        advice=(
            "the residuals of a 2D image cannot tell; check the image's orientation in the recording (MF, UF, ...) "
            "and the scanner's left-right mark, then calibrate again"
        ),
    )


def check_needle_end(evidence: Evidence) -> Iterator[Diagnostic]:
    """Was the needle seen on the segment that is said to be it, or beyond one of its ends?

    The fit uses the infinite line and does not notice; whatever uses the tip will.
    """
    agree = evidence.inlier
    if not agree.any() or not isinstance(evidence.mapped, MappedRows):
        return
    along, lengths = evidence.mapped.along_mm[agree], evidence.mapped.lengths_mm[agree]
    for name, past in (("first", -along), ("second", along - lengths)):
        share = np.count_nonzero(past > BEYOND_END_MM) / len(past)
        if share > 0.5:
            yield Diagnostic(
                code="wrong-end-of-needle",
                severity="warning",
                message=(
                    f"{100 * share:.0f} % of the rows see the needle beyond the {name} end of its segment, by "
                    f"{np.median(past[past > BEYOND_END_MM]):.0f} mm in the middle"
                ),
                advice=(
                    "check the sign and the length of the needle's far end in its marker's frame (from_mm, to_mm); "
                    "the calibration stands, but a tip taken from this needle is wrong"
                ),
            )


def check_tool_frame(
    table: PointLineRows | TargetRows,
    *,
    tracker_from_probe: Array | None = None,
    threshold_mm: float = 5.0,
    agreeing: float | None = None,
) -> Iterator[Diagnostic]:
    """Are the lines in the probe marker's frame?

    Args:
        table: the rows to fit.
        tracker_from_probe: (N, 4, 4), the probe's pose of each row: tells which frame the lines are in instead.
        threshold_mm: rows further than this from their line do not agree.
        agreeing: share of the rows that agree as they stand, where that is known already.
    """
    share = _agreeing_share(table, threshold_mm) if agreeing is None else agreeing
    found: dict[str, float] = {}
    if tracker_from_probe is not None:
        inverse = np.linalg.inv(tracker_from_probe)
        for where, pose in (("the tracker's frame", inverse), ("a frame twice removed", tracker_from_probe)):
            moved = np.einsum("nij,nkj->nki", pose[:, :3, :3], table.spanning_mm) + pose[:, None, :3, 3]
            found[where] = _agreeing_share(table.with_spanning(moved), threshold_mm)
    best = max(found, key=lambda name: found[name]) if found else ""
    if found and found[best] > max(GOOD_SHARE, share + GAIN):
        yield wrong_frame(
            f"only {100 * share:.0f} % of the rows agree as they stand, and {100 * found[best]:.0f} % when the lines "
            f"are taken to be in {best}",
            "carry the lines into the probe marker's frame: probe_from_needle = probe_from_tracker @ "
            "tracker_from_needle, and mind which way each transform goes",
        )
    elif share < POOR_SHARE:
        yield wrong_frame(
            f"only {100 * share:.0f} % of the rows agree, hardly more than rows in no common frame would"
        )


def _agreeing_share(table: PointLineRows | TargetRows, threshold_mm: float) -> float:
    found = quick_fit(table, threshold_mm)
    if found is None:
        return 0.0
    # An image shrunk to nothing agrees with all lines that pass near one point.
    lengths = float(np.ptp(found.transform.apply(table.points), axis=0).max())
    return 0.0 if lengths < 2.0 * threshold_mm else float(found.inlier.mean())


def quick_fit(
    table: PointLineRows | TargetRows, threshold_mm: float, scale_mm_per_px: float | None = None
) -> Fit | None:
    """The fit of rows that may make no sense, from fewer samples; None where there is none."""
    model: Model = "similarity" if scale_mm_per_px is None else "rigid"
    options = Options(
        threshold_mm=threshold_mm, max_samples=FEW_SAMPLES, model=model, scale_mm_per_px=scale_mm_per_px
    )
    try:
        return best_fit(table, options)[0]
    except (NoConsensusError, DegenerateGeometryError):
        return None


def wrong_frame(message: str, advice: str = WHICH_FRAME) -> Diagnostic:
    """The finding that lines are not in the frame that they are said to be in."""
    return Diagnostic(code="wrong-tool-frame", severity="warning", message=message, advice=advice)
