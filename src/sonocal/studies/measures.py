"""Errors of many calibrations against the truth, and the least that noise allows."""

from __future__ import annotations

import numpy as np

from sonocal import _core
from sonocal.geometry import Array
from sonocal.studies.scene import Scene, Trials

__all__ = ["ERRORS", "QUANTITIES", "bound_errors", "calibration_errors", "target_place", "wire_errors"]

ERRORS = ("rotation_deg", "translation_mm", "scale_mm_per_px", "target_mm")
"""One number a trial."""

QUANTITIES = {
    "rotation_deg": "Rotation error, deg",
    "translation_mm": "Translation error, mm",
    "scale_mm_per_px": "Scale error, mm/px",
    "target_mm": "Error at the target, mm",
    "pra_mm": "Reconstruction error (PRA), mm",
}


def target_place(scene: Scene) -> Array:
    """(3,), px: the middle of the image at the target's depth."""
    across = 0.5 * scene.image_px
    depth = scene.depth_mm / scene.scale_mm_per_px
    return np.array([across, depth, across if scene.dimension == 3 else 0.0])


def calibration_errors(scene: Scene, found: Array, truth: Array) -> Array:
    """Errors (..., 4) in the order of ERRORS.

    Angle of R^T R_true, |t - t_true|, |s - s_true|, and the distance of the mapped target from where it is.

    Args:
        scene: where the target is.
        found: (..., 4, 4), mm from px; NaN gives NaN.
        truth: the same, broadcast.

    Source: paper section 9.1.
    """
    scale, true_scale = (np.linalg.norm(a[..., :3, 0], axis=-1) for a in (found, truth))
    rotation = found[..., :3, :3] / scale[..., None, None]
    true_rotation = truth[..., :3, :3] / true_scale[..., None, None]
    # The chord |R - R_true| keeps its digits at small angles, where the arc cosine of the trace loses half.
    chord = np.sqrt(np.sum((rotation - true_rotation) ** 2, axis=(-2, -1)))
    angle = np.degrees(2 * np.arcsin(np.minimum(chord / np.sqrt(8), 1)))
    off = found - truth
    target = np.einsum("...ij,j->...i", off[..., :3, :3], target_place(scene)) + off[..., :3, 3]
    return np.stack(
        [
            angle,
            np.linalg.norm(off[..., :3, 3], axis=-1),
            np.abs(scale - true_scale),
            np.linalg.norm(target, axis=-1),
        ],
        axis=-1,
    )


def wire_errors(found: Array, trials: Trials) -> Array:
    """Projection reconstruction accuracy (T, ..., K), mm: |A x - P| at every sighting of the cross-wire.

    Args:
        found: (T, ..., 4, 4), mm from px.
        trials: with K sightings each.

    Source: paper section 9.2.
    """
    extra = (1,) * (found.ndim - 3)
    pixels = trials.wire_points.reshape(len(trials), *extra, -1, 3)
    places = trials.wire_places.reshape(len(trials), *extra, -1, 3)
    mapped = np.einsum("...ij,...kj->...ki", found[..., :3, :3], pixels) + found[..., None, :3, 3]
    return np.asarray(np.linalg.norm(mapped - places, axis=-1))


def bound_errors(scene: Scene, trials: Trials) -> tuple[Array, Array]:
    """What an estimate that attains the Cramer-Rao bound would be off by.

    Returns:
        Its root mean square errors (T, 4) in the order of ERRORS, and errors (T, 4) drawn from its normal
        distribution, one draw a trial. NaN for scenes whose noise is more than points' and ends'.
    """
    count = len(trials)
    if (
        scene.probe_sigma_mm
        or scene.probe_sigma_deg
        or scene.latency_ms
        or scene.sigma_px + scene.sigma_mm == 0
    ):
        return np.full((count, len(ERRORS)), np.nan), np.full((count, len(ERRORS)), np.nan)
    covariance = _core.study_bounds(
        trials.true_points,
        trials.true_segments,
        trials.sound,
        trials.truth,
        dimension=scene.dimension,
        level_px=scene.sigma_px,
        level_mm=scene.sigma_mm,
        threads=1,
    )
    linear = trials.truth[:, :3, :3]
    scale = np.linalg.norm(linear[:, :, 0], axis=-1)
    to_target = _target_jacobian(np.einsum("tij,j->ti", linear, target_place(scene)))
    target = np.einsum("tik,tkl,til->t", to_target, covariance, to_target)
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    rotation, translation = variances[:, :3].sum(axis=1), variances[:, 3:6].sum(axis=1)
    rms = np.sqrt(
        np.stack([np.degrees(1) ** 2 * rotation, translation, scale**2 * variances[:, 6], target], -1)
    )
    return rms, _drawn(covariance, to_target, scale, trials)


def _target_jacobian(mapped: Array) -> Array:
    """(T, 3, 7): how a target, S x = (T, 3), moves with the tangent."""
    jacobian = np.zeros((len(mapped), 3, 7))
    x, y, z = mapped.T
    jacobian[:, 0, 1], jacobian[:, 0, 2] = z, -y
    jacobian[:, 1, 0], jacobian[:, 1, 2] = -z, x
    jacobian[:, 2, 0], jacobian[:, 2, 1] = y, -x
    jacobian[:, :, 3:6] = np.eye(3)
    jacobian[:, :, 6] = mapped
    return jacobian


def _drawn(covariance: Array, to_target: Array, scale: Array, trials: Trials) -> Array:
    values, vectors = np.linalg.eigh(np.nan_to_num(covariance))
    step = np.einsum("tij,tj->ti", vectors, np.sqrt(np.maximum(values, 0)) * trials.white)
    errors = np.stack(
        [
            np.degrees(np.linalg.norm(step[:, :3], axis=1)),
            np.linalg.norm(step[:, 3:6], axis=1),
            scale * np.abs(step[:, 6]),
            np.linalg.norm(np.einsum("tij,tj->ti", to_target, step), axis=1),
        ],
        axis=-1,
    )
    return np.where(np.isfinite(covariance[:, 0, 0])[:, None], errors, np.nan)
