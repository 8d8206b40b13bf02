"""Where the tip of a tool is in its marker's frame, from turning the tool about its resting tip.

    R_i tip + t_i = pivot        i = 1..N, [R_i t_i] = tracker_from_tool

Linear in (tip, pivot): least squares on the poses that agree (least median of squares over minimal
triples), reweighted to rest. The small residual that pivot calibrations report says little: a tool that
is hardly tilted, or turned about one axis only, fits any tip along that axis. What is refused and warned
of here is that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.recording.poses import RIGID_TOLERANCE, rigidity_error

__all__ = ["PivotCalibration", "calibrate_pivot", "rotation_spread_deg"]

MINIMAL_POSES = 3
LEAST_POSES = 10
TRIALS = 300
# Spread of the tool's directions about the axis it turned most around, degrees rms. Below the first the
# tip cannot be told from its neighbours along that axis; below the second its error is large.
LEAST_SPREAD_DEG = 2.0
GOOD_SPREAD_DEG = 10.0
STILL_DEG = 1.0
GOOD_RMS_MM = 1.0
GOOD_INLIERS = 0.7
# A tip that half of the poses miss by more than this did not rest anywhere.
LOOSEST_MM = 5.0
TUKEY = 4.685
# Distances beyond this many deviations per coordinate are no noise: 1 in 10 000 of a normal distribution in space.
CUT = 4.6
FLOOR_MM = 1e-6
PARTS = 3
BLOCKS = 20


@dataclass(frozen=True, eq=False)
class PivotCalibration:
    """The tip of a tool, and how far to trust it.

    Attributes:
        tip_mm: (3,), in the tool marker's frame.
        pivot_mm: (3,), where the tip rested, in the tracker's frame.
        covariance: (6, 6) of (tip, pivot), mm^2; counts that neighbouring poses share their error.
        rms_mm, max_mm: distances of the tip from the pivot over the agreeing poses.
        inlier: (N,): the poses that agree.
        spread_deg: rms angle of the tool about the axis it turned least about.
        diagnostics: what to know before use.
    """

    tip_mm: Array
    pivot_mm: Array
    covariance: Array
    rms_mm: float
    max_mm: float
    inlier: NDArray[np.bool_]
    spread_deg: float
    diagnostics: tuple[Diagnostic, ...]

    @property
    def tip_deviation_mm(self) -> float:
        """Standard deviation of the tip's place, mm."""
        return float(np.sqrt(np.trace(self.covariance[:3, :3])))

    @property
    def tip_95_mm(self) -> float:
        """How far the tip may be off along the direction in which it is known least, mm, in 95 of 100 cases."""
        return float(1.96 * np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))


def calibrate_pivot(
    tracker_from_tool: ArrayLike, valid: ArrayLike | None = None, seed: int = 0, source: str = "poses"
) -> PivotCalibration:
    """The tip of a tool that was turned about it.

    Args:
        tracker_from_tool: (N, 4, 4), in the order recorded.
        valid: (N,) which of them to use; default: all that are finite.
        seed: of the random triples.
        source: what messages call the recording.

    Raises:
        InputError: too few poses, or one is not rigid.
        DegenerateGeometryError: the tool was still ("still") or hardly tilted ("little-tilt").
        NoConsensusError: less than half of the poses share a tip.
    """
    poses, used = checked_poses(tracker_from_tool, valid, source)
    rotations, places = poses[used, :3, :3], poses[used, :3, 3]
    _refuse_still(rotations, source)
    start = _least_median(rotations, places, np.random.default_rng(seed), source)
    solution, agrees = _settled(rotations, places, *_reweighted(rotations, places, start))
    residuals = _residuals(rotations, places, solution)
    distance = np.linalg.norm(residuals, axis=1)
    _refuse_discord(distance, source)
    spread = rotation_spread_deg(rotations[agrees])
    _refuse_little_tilt(rotations[agrees], spread, source)
    inlier = np.zeros(len(poses), dtype=bool)
    inlier[np.flatnonzero(used)[agrees]] = True
    rms = float(np.sqrt(np.mean(distance[agrees] ** 2)))
    covariance = _covariance(rotations[agrees], residuals[agrees])
    tip, pivot = solution[:3], solution[3:]
    findings = _findings(
        rotations[agrees],
        residuals[agrees],
        rms=rms,
        agreeing=float(agrees.mean()),
        spread=spread,
        covariance=covariance,
    )
    return PivotCalibration(
        tip, pivot, covariance, rms, float(distance[agrees].max()), inlier, spread, tuple(findings)
    )


def rotation_spread_deg(rotations: Array) -> float:
    """Rms angle by which the tool's axes moved about the direction in which they moved least, degrees.

    Zero for a still tool, and for one that turned about a single axis only. It is the square root of the
    smallest eigenvalue of ``I - M^T M``, M the mean rotation: what the poses tell of the tip.
    """
    return float(np.degrees(np.sqrt(_tip_information(rotations)[0][0])))


def checked_poses(poses: ArrayLike, valid: ArrayLike | None, source: str) -> tuple[Array, NDArray[np.bool_]]:
    """The poses as an array, and which of them to use; refuses too few and those that are not rigid."""
    array = np.asarray(poses, dtype=float)
    if array.ndim != 3 or array.shape[1:] != (4, 4):
        raise InputError(f"{source}: poses must have shape (N, 4, 4); got {array.shape}")
    used = np.isfinite(array).all(axis=(1, 2))
    if valid is not None:
        used &= np.asarray(valid, dtype=bool)
    if used.sum() < LEAST_POSES:
        raise InputError(
            f"{source}: has {used.sum()} valid poses; a tool calibration needs {LEAST_POSES}, better 200"
        )
    bent = used & ~(rigidity_error(array) <= RIGID_TOLERANCE)
    if bent.any():
        i = int(np.flatnonzero(bent)[0])
        raise InputError(
            f"{source}, frame {i}: its pose is not rigid (det R = {np.linalg.det(array[i, :3, :3]):.3g}); "
            "drop such frames with --on-invalid skip"
        )
    return array, used


def _tip_information(rotations: Array) -> tuple[Array, Array]:
    mean = rotations.mean(axis=0)
    values, vectors = np.linalg.eigh(np.eye(3) - mean.T @ mean)
    return np.clip(values, 0.0, None), vectors


def _refuse_still(rotations: Array, source: str) -> None:
    turned = float(np.degrees(np.sqrt(_tip_information(rotations)[0][2])))
    if turned < STILL_DEG:
        raise DegenerateGeometryError(
            f"{source}: the tool hardly turned ({turned:.2f} deg rms), so any tip fits; "
            "rest the tip in a divot and tilt the tool by 30 deg or more, to all sides",
            "still",
        )


def _refuse_discord(distance: Array, source: str) -> None:
    close = int((distance <= LOOSEST_MM).sum())
    if 2 * close < len(distance):
        raise NoConsensusError(
            f"{source}: only {close} of {len(distance)} poses share a tip within {LOOSEST_MM:g} mm; "
            "rest the tip in one divot throughout",
            close,
        )


def _refuse_little_tilt(rotations: Array, spread: float, source: str) -> None:
    if spread < LEAST_SPREAD_DEG:
        axis = ", ".join(f"{x:.2f}" for x in _tip_information(rotations)[1][:, 0])
        raise DegenerateGeometryError(
            f"{source}: the tool turned about one axis only ({spread:.2f} deg rms across it), so the tip is free along "
            f"({axis}) of its marker; tilt it by 30 deg or more, to all sides",
            "little-tilt",
        )


def _least_median(rotations: Array, places: Array, rng: np.random.Generator, source: str) -> Array:
    """The tip and pivot of the triple of poses whose median residual over all poses is least."""
    picks = np.argsort(rng.random((TRIALS, len(rotations))), axis=1)[:, :MINIMAL_POSES]
    means = rotations[picks].mean(axis=1)
    smallest = np.linalg.eigvalsh(np.eye(3) - np.swapaxes(means, 1, 2) @ means)[:, 0]
    # Poses that hardly differ say nothing of the tip; their solution would be noise.
    telling = picks[smallest > np.radians(LEAST_SPREAD_DEG / 2) ** 2]
    if len(telling) == 0:
        _refuse_little_tilt(rotations, 0.0, source)
    system = _system(rotations)[telling].reshape(-1, 3 * MINIMAL_POSES, 6)
    target = -places[telling].reshape(-1, 3 * MINIMAL_POSES, 1)
    solutions = (np.linalg.pinv(system) @ target)[..., 0]
    residuals = np.einsum("nij,tj->tni", rotations, solutions[:, :3]) + places - solutions[:, None, 3:]
    scores = np.median(np.sum(residuals**2, axis=2), axis=1)
    return np.asarray(solutions[np.argmin(scores)])


def _reweighted(rotations: Array, places: Array, solution: Array) -> tuple[Array, float]:
    """Tukey's biweight to rest; the scale comes from the start and is then refined with the inliers."""
    sigma = _robust_sigma(_residuals(rotations, places, solution))
    for _ in range(50):
        ratio = np.linalg.norm(_residuals(rotations, places, solution), axis=1) / (TUKEY * sigma)
        weight = np.where(ratio < 1, (1 - np.minimum(ratio, 1) ** 2) ** 2, 0.0)
        if (weight > 0).sum() < MINIMAL_POSES:
            break
        change, solution = solution, _solve(rotations, places, weight)
        sigma = min(sigma, _robust_sigma(_residuals(rotations, places, solution)))
        if np.abs(change - solution).max() < 1e-9:
            break
    return solution, sigma


def _settled(
    rotations: Array, places: Array, solution: Array, sigma: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Least squares over the poses within the cut, which follows from them, until the set is at rest.

    Clean recordings have flat tails, not outliers: all of them count then, and nothing is lost to the weights.
    """
    agrees = np.zeros(len(rotations), dtype=bool)
    for _ in range(50):
        distance = np.linalg.norm(_residuals(rotations, places, solution), axis=1)
        before, agrees = agrees, distance <= max(CUT * sigma, FLOOR_MM)
        if agrees.sum() < MINIMAL_POSES or np.array_equal(before, agrees):
            break
        solution = _solve(rotations, places, agrees.astype(float))
        left = _residuals(rotations[agrees], places[agrees], solution)
        sigma = float(np.sqrt(np.mean(left**2)))
    return solution, agrees


def _robust_sigma(residuals: Array) -> float:
    """Standard deviation per coordinate from the median distance of a normal distribution in space."""
    return max(float(np.median(np.linalg.norm(residuals, axis=1))) / 1.538, FLOOR_MM / TUKEY)


def _solve(rotations: Array, places: Array, weight: Array) -> Array:
    """(6,): tip and pivot of ``R_i tip - pivot = -t_i`` in weighted least squares."""
    root = np.sqrt(weight)[:, None, None]
    system = _system(rotations) * root
    target = -(places * root[..., 0]).reshape(-1)
    return np.asarray(np.linalg.lstsq(system.reshape(-1, 6), target, rcond=None)[0])


def _system(rotations: Array) -> Array:
    """(N, 3, 6): the rows of one pose."""
    return np.concatenate([rotations, np.broadcast_to(-np.eye(3), rotations.shape)], axis=2)


def _residuals(rotations: Array, places: Array, solution: Array) -> Array:
    return np.asarray(rotations @ solution[:3] + places - solution[3:])


def _covariance(rotations: Array, residuals: Array) -> Array:
    """(6, 6): the larger of the textbook covariance and the one that blocks of neighbours show.

    Neighbouring poses share their error (a marker seen at one angle), so counting each as a measurement of
    its own promises far too much.
    """
    jacobian = _system(rotations)
    n = len(jacobian)
    bread = np.linalg.inv(np.einsum("nij,nik->jk", jacobian, jacobian))
    white = bread * float(np.sum(residuals**2)) / max(3 * n - 6, 1)
    blocks = min(BLOCKS, n // 5)
    if blocks < 6:
        return np.asarray(white)
    gradient = np.einsum("nij,ni->nj", jacobian, residuals)
    sums = np.array([part.sum(axis=0) for part in np.array_split(gradient, blocks)])
    clustered = bread @ (sums.T @ sums) @ bread * blocks / (blocks - 1)
    return np.asarray(clustered if np.trace(clustered[:3, :3]) > np.trace(white[:3, :3]) else white)


def _findings(
    rotations: Array, residuals: Array, *, rms: float, agreeing: float, spread: float, covariance: Array
) -> Iterator[Diagnostic]:
    if spread < GOOD_SPREAD_DEG:
        deviation = float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
        yield _warning(
            "little-tilt",
            f"the tool was tilted by {spread:.1f} deg rms only: along one direction the tip is known to "
            f"+-{1.96 * deviation:.2g} mm however small the residual of {rms:.2f} mm",
            "pivot again with tilts of 30 deg or more to all sides",
        )
    if rms > GOOD_RMS_MM:
        yield _warning(
            "large-residual",
            f"the tip moves by {rms:.2f} mm rms about the pivot",
            "use a divot that holds the tip, and check that the marker is rigid on the tool",
        )
    if agreeing < GOOD_INLIERS:
        yield _warning(
            "many-outliers",
            f"{100 * (1 - agreeing):.0f} % of the poses do not share the tip and were left out",
            "look at the stretch they come from; pivot again if it is not the start or the end",
        )
    yield from _slip(rotations, residuals)


def _slip(rotations: Array, residuals: Array) -> Iterator[Diagnostic]:
    """A tip that moved during the recording: the pivot of its parts differs by more than they can tell."""
    if len(residuals) < PARTS * LEAST_POSES:
        return
    parts = np.array_split(np.arange(len(residuals)), PARTS)
    means = np.array([residuals[p].mean(axis=0) for p in parts])
    spread_mm = float(np.sqrt(np.mean([residuals[p].var(axis=0).sum() for p in parts])))
    moved = max(float(np.linalg.norm(a - b)) for a in means for b in means)
    if moved > max(2 * spread_mm, 0.3):
        yield _warning(
            "slipped-tip",
            f"the pivot lies {moved:.2f} mm apart in different thirds of the recording, where each third holds it to "
            f"{spread_mm:.2f} mm: the tip slipped or the marker moved",
            "pivot again without letting the tip leave its divot",
        )


def _warning(code: str, message: str, advice: str) -> Diagnostic:
    return Diagnostic(code=code, severity="warning", message=message, advice=advice)
