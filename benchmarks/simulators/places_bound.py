"""The least error that a calibration can have whose target nobody placed (Cramer and Rao), by numbers alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.simulators.mixes import Array
from benchmarks.simulators.places import Noise, Sweep, image_points

__all__ = ["least_error_mm"]


def least_error_mm(scene: Sweep, noise: Noise) -> tuple[float, Array]:
    """The least rms error over the image (Cramer and Rao), mm, and the covariance (7 + place, square)."""
    spans = len(scene.place)
    frame = np.linalg.svd(scene.place[1:] - scene.place[0], full_matrices=True)[2] if spans > 1 else np.eye(3)
    along, normals = frame[: spans - 1], frame[spans - 1 :]
    count = 7 + len(normals) * spans
    keep = ~scene.wrong

    nothing, none = np.zeros(count), np.zeros(15)

    def away(i: int, tangent: Array, error: Array) -> Array:
        linear = np.exp(tangent[6]) * Rotation.from_rotvec(tangent[:3]).as_matrix() @ scene.truth[:3, :3]
        point = linear @ (scene.points_px[i] + error[:3]) + scene.truth[:3, 3] + tangent[3:6]
        point = Rotation.from_rotvec(error[3:6]).as_matrix() @ point + error[6:9]
        pose = scene.true_poses[i]
        point = pose[:3, :3].T @ (point - pose[:3, 3])
        point = Rotation.from_rotvec(error[9:12]).as_matrix() @ point + error[12:15] - scene.place[0]
        turned = normals + np.einsum(
            "nk,ki->ni", tangent[7 + len(normals) :].reshape(len(normals), spans - 1), along
        )
        return turned @ point - tangent[7 : 7 + len(normals)]

    flat = scene.dimension == 2
    sigma = np.r_[noise.px, noise.px, 0 if flat else noise.px]
    body = np.r_[np.full(3, np.deg2rad(noise.deg)), np.full(3, noise.mm)]
    information = np.zeros((count, count))
    for f in np.unique(scene.frame[keep]):
        rows = np.flatnonzero((scene.frame == f) & keep)
        by_tangent = np.vstack([_derivative(lambda x, i=i: away(i, x, none), count).T for i in rows])
        errors = [_derivative(lambda x, i=i: away(i, nothing, x), 15).T for i in rows]
        tail = np.r_[body, body * scene.tracked]
        shared = np.vstack([e[:, 3:] * tail for e in errors])
        covariance = shared @ shared.T
        at = 0
        for e in errors:
            own = e[:, :3] * sigma
            covariance[at : at + len(e), at : at + len(e)] += own @ own.T
            at += len(e)
        information += by_tangent.T @ np.linalg.solve(covariance, by_tangent)
    bound = np.linalg.pinv(information)
    arms = image_points(scene.dimension) @ scene.truth[:3, :3].T
    by = np.zeros((len(arms), 3, count))
    for axis in range(3):
        by[:, :, axis] = np.cross(np.eye(3)[axis], arms)
    by[:, :, 3:6], by[:, :, 6] = np.eye(3), arms
    return float(np.sqrt(np.einsum("nia,ab,nib->n", by, bound, by).mean())), bound


def _derivative(of: Callable[[Array], Array], count: int, step: float = 1e-5) -> Array:
    """(count, ...): by central differences."""
    return np.array([(of(move) - of(-move)) / (2 * step) for move in step * np.eye(count)])
