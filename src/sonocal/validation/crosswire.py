"""Errors at points: a cross-wire touched by the tip, a fixed unknown one, a known phantom."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sonocal.errors import DegenerateGeometryError, InputError
from sonocal.geometry import Array, AxisScaled, Similarity, homogeneous_points
from sonocal.observations import group_codes
from sonocal.validation.point_table import PointSightings
from sonocal.validation.quantity import Quantity, rms_quantity
from sonocal.validation.turns import turned_deg

__all__ = ["CrosswireFit", "fit_crosswire", "fixed_point_spread", "reconstruction_accuracy"]


# Turned by less, a probe carries an error of its calibration along, to a twelfth of itself.
LEAST_TURN_DEG = 5.0


@dataclass(frozen=True, eq=False)
class CrosswireFit:
    """A calibration from one fixed point seen from many poses.

    Attributes:
        probe_from_image: mm from px.
        point_mm: (3,): where the point is in the tracker's frame.
        residuals_mm: (N,): distance of each reconstructed point to it.
        linear_rms_mm: rms distance of the linear fit it started from, whose image axes are free.
    """

    probe_from_image: Similarity
    point_mm: Array
    residuals_mm: Array
    linear_rms_mm: float


def reconstruction_accuracy(probe_from_image: AxisScaled, sightings: PointSightings) -> Quantity:
    """Projection reconstruction accuracy (PRA): distance of mapped points to where they are known to be.

        e_i = |A x_i - P_i|

    The points are known from the tip of a tracked needle that touched them, or from the drawing of a phantom;
    what that knowledge is off by counts too.

    Raises:
        InputError: the table does not say where the points are.

    Source: paper section 9.2.
    """
    known = sightings.points_probe_mm
    errors = np.linalg.norm(probe_from_image @ sightings.points_px - known, axis=1)
    several = len(np.unique(sightings.target)) > 1
    return rms_quantity(
        "pra-phantom" if several else "pra-crosswire",
        "PRA, known phantom" if several else "PRA, cross-wire",
        "distance of a mapped image point to where the point is known to be, rms (projection reconstruction accuracy)",
        np.asarray(errors),
        group_codes(sightings.frame),
    )


def fixed_point_spread(probe_from_image: AxisScaled, sightings: PointSightings) -> Quantity:
    """Spread of the reconstructions of fixed points of unknown place, seen from many poses.

        X_i = tracker_from_probe_i A x_i,        spread^2 = sum_i |X_i - mean|^2 / (n - 1)

    An error that every pose shares in the tracker's frame does not show: turn the probe between sightings.

    Raises:
        InputError: the table has no poses, no point is seen twice, or the probe hardly turned, so that no error of the
            calibration would show.

    Source: point reconstruction precision, Hsu et al. 2008; Mercier et al. 2005, section 5.
    """
    reconstructed = _carried(sightings.poses, probe_from_image @ sightings.points_px)
    target = group_codes(sightings.target)
    counts = np.bincount(target)
    if counts.max() < 2:
        raise InputError(f"{sightings.source}: no point is seen twice; scan the cross-wire from many poses")
    rotations = sightings.poses[:, :3, :3]
    turned = float(turned_deg(rotations[0], rotations).max())
    if turned < LEAST_TURN_DEG:
        raise InputError(
            f"{sightings.source}: the probe turned by {turned:.1f} deg between sightings, so that no error of the "
            "calibration shows; turn it by 30 deg or more, about two axes"
        )
    mean = np.stack([np.bincount(target, column) / counts for column in reconstructed.T], axis=1)
    unbiased = np.sqrt(counts / np.maximum(counts - 1, 1))[target]
    errors = np.linalg.norm(reconstructed - mean[target], axis=1) * unbiased
    repeated = counts[target] > 1
    return rms_quantity(
        "crosswire-spread",
        "Spread at a fixed cross-wire",
        "distance of a point's reconstructions from many poses to their mean, rms",
        errors[repeated],
        group_codes(sightings.frame)[repeated],
    )


def fit_crosswire(sightings: PointSightings) -> CrosswireFit:
    """Calibrate from one fixed point of unknown place alone, seen from many poses.

        min over A, P of sum_i |tracker_from_probe_i A x_i - P|^2

    The start is linear in the image's two axes, the offset and the point; their nearest similarity is then
    refined. It serves where there is no other calibration, and as a check of one.

    Raises:
        InputError: the table has no poses or several points, or is that of a 3D probe.
        DegenerateGeometryError: the poses leave a motion free.

    Source: Prager et al. 1998 (cross-wire); Mercier et al. 2005, section 3.1.
    """
    from scipy.optimize import least_squares

    poses, pixels = sightings.poses, sightings.points_px
    if pixels.shape[1] != 2 or len(np.unique(sightings.target)) > 1:
        raise InputError(f"{sightings.source}: a cross-wire calibration needs 2D image points of one target")
    start, point, linear_rms = _linear_crosswire(poses, pixels)
    size = float(np.abs(pixels).max())

    def residuals(step: Array) -> Array:
        a = start.retract(step[:7] / [size, size, size, 1, 1, 1, size])
        return np.asarray((_carried(poses, a @ pixels) - point - step[7:]).ravel())

    found = least_squares(residuals, np.zeros(10), x_scale="jac")
    a = start.retract(found.x[:7] / [size, size, size, 1, 1, 1, size])
    return CrosswireFit(
        probe_from_image=a,
        point_mm=point + found.x[7:],
        residuals_mm=np.linalg.norm(found.fun.reshape(-1, 3), axis=1),
        linear_rms_mm=linear_rms,
    )


def _linear_crosswire(poses: Array, pixels: Array) -> tuple[Similarity, Array, float]:
    """Least squares for (a_u, a_v, t, P) in R_i (a_u u_i + a_v v_i + t) - P = -t_i."""
    rotations, scale = poses[:, :3, :3], float(np.abs(pixels).max()) or 1.0
    u, v = (pixels / scale).T[:, :, None, None]
    minus_one = np.broadcast_to(-np.eye(3), rotations.shape)
    system = np.concatenate([rotations * u, rotations * v, rotations, minus_one], axis=2).reshape(-1, 12)
    right = -poses[:, :3, 3].reshape(-1)
    solution, _, rank, _ = np.linalg.lstsq(system, right, rcond=1e-9)
    if rank < 12:
        raise DegenerateGeometryError(
            "the poses leave the cross-wire calibration free; turn the probe about two axes, by 30 degrees or "
            "more, and bring the wire to places all over the image",
            code="crosswire-poses",
        )
    columns = np.stack([solution[:3], solution[3:6]], axis=1) / scale
    left, values, right_vectors = np.linalg.svd(columns, full_matrices=False)
    in_plane = left @ right_vectors
    rotation = np.column_stack([in_plane, np.cross(in_plane[:, 0], in_plane[:, 1])])
    rms = float(np.sqrt(np.sum((system @ solution - right) ** 2) / len(poses)))
    return Similarity(rotation, solution[6:9], values.mean()), solution[9:], rms


def _carried(poses: Array, points: ArrayLike) -> Array:
    """Points (N, 3), each by its own pose (N, 4, 4)."""
    return np.asarray(np.einsum("nij,nj->ni", poses[:, :3, :3], homogeneous_points(points)) + poses[:, :3, 3])
