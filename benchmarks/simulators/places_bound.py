"""The least error that a calibration can have whose target nobody placed (Cramer and Rao), by numbers alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.simulators.mixes import Array
from benchmarks.simulators.places import Noise, Sweep, image_points

__all__ = ["Prior", "least_error_mm"]

# How well a place is known: mm across, and degrees of each direction at right angles to it.
Prior = tuple[float, float]


def least_error_mm(
    scene: Sweep, noise: Noise, *, known: bool = False, prior: Prior | None = None
) -> tuple[float, Array]:
    """The least rms error over the image (Cramer and Rao), mm, and the covariance (7 + place, square).

    Args:
        scene: with its truth.
        noise: of points and of each tracked pose, which rows of a frame share.
        known: the place is known exactly.
        prior: or so well.
    """
    spans = len(scene.place)
    frame = np.linalg.svd(scene.place[1:] - scene.place[0], full_matrices=True)[2] if spans > 1 else np.eye(3)
    along, normals = frame[: spans - 1], frame[spans - 1 :]
    count = 7 + (0 if known else len(normals) * spans)
    rows = np.flatnonzero(~scene.wrong)
    poses, points = scene.true_poses[rows], scene.points_px[rows]

    def away(tangent: Array, error: Array) -> Array:
        """(N, normals): of every row, from where the target is."""
        linear = np.exp(tangent[6]) * Rotation.from_rotvec(tangent[:3]).as_matrix() @ scene.truth[:3, :3]
        point = (points + error[:3]) @ linear.T + scene.truth[:3, 3] + tangent[3:6]
        point = point @ Rotation.from_rotvec(error[3:6]).as_matrix().T + error[6:9]
        point = np.einsum("nji,nj->ni", poses[:, :3, :3], point - poses[:, :3, 3])
        point = point @ Rotation.from_rotvec(error[9:12]).as_matrix().T + error[12:15] - scene.place[0]
        if known:
            return point @ normals.T
        turned = normals + tangent[7 + len(normals) :].reshape(len(normals), spans - 1) @ along
        return point @ turned.T - tangent[7 : 7 + len(normals)]

    by_tangent = np.moveaxis(
        _derivative(lambda x: away(x, np.zeros(15)), count), 0, -1
    )  # (N, normals, count)
    by_error = np.moveaxis(_derivative(lambda x: away(np.zeros(count), x), 15), 0, -1)
    own = by_error[..., :3] * np.r_[noise.px, noise.px, 0 if scene.dimension == 2 else noise.px]
    body = np.r_[np.full(3, np.deg2rad(noise.deg)), np.full(3, noise.mm)]
    shared = by_error[..., 3:] * np.r_[body, body * scene.tracked]
    information = np.zeros((count, count))
    for f in np.unique(scene.frame[rows]):
        mine = np.flatnonzero(scene.frame[rows] == f)
        size = len(normals)
        of_poses = shared[mine].reshape(-1, 12)
        covariance = of_poses @ of_poses.T
        for at, row in enumerate(mine):
            block = slice(at * size, (at + 1) * size)
            covariance[block, block] += own[row] @ own[row].T
        jacobian = by_tangent[mine].reshape(-1, count)
        information += jacobian.T @ np.linalg.solve(covariance, jacobian)
    if prior is not None:
        turns = (spans - 1) * len(normals)
        sigma = np.r_[np.full(len(normals), prior[0]), np.full(turns, np.deg2rad(prior[1]))]
        information[7:, 7:] += np.diag(sigma**-2.0)
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
