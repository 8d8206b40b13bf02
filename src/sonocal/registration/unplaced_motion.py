"""What a motion cannot give: refused by name, however well the rows agree."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import DegenerateGeometryError
from sonocal.geometry import Array, AxisScaled, Similarity
from sonocal.registration.uncertainty import point_covariance, radius_95
from sonocal.registration.unplaced_rows import UnplacedRows

__all__ = ["missing_motion", "refuse_collapse", "refuse_missing", "refuse_motion", "turns_deg"]

# As much noise again multiplies what is known of a motion by this: of geometry it is 1, of noise alone 2.
MOST_GROWTH = 1.25
# Root mean square turns about the second of three axes, degrees.
LEAST_TURN_DEG = 5.0
# At a corner of what was seen, with noise as it is expected of the tracker and the images (95 %).
MOST_ERROR_MM = 5.0
# Root mean square distance of the image's points from their mean, along the image's second axis.
LEAST_SPREAD_PX = 10.0
# Of all that was seen.
LEAST_EXTENT_MM = 2.0
MOST_SAID_MM = 1e3

TOO_LITTLE = "the motion tells the calibration from the target's place too little", "motion"
SCALE = "the motion leaves the scale free", "scale"


def refuse_motion(
    rows: UnplacedRows, inlier: NDArray[np.bool_], transform: AxisScaled, nominal: Array, growth: float
) -> None:
    """Refuse an answer that the motion does not hold.

    A small residual proves nothing: with the place free, a motion that is missing takes up what it would tell. What
    noise makes of such a motion looks like knowledge; as much noise again would double it.

    Args:
        rows: what was seen.
        inlier: (N,): rows that agree.
        transform: mm from px.
        nominal: covariance of its tangent, and more, with noise not less than expected.
        growth: what as much noise again multiplies the knowledge of the worst motion by.

    Raises:
        DegenerateGeometryError: which motion is missing, and what to do.
    """
    missing = missing_motion(rows, inlier)
    worst = _worst_mm(rows, transform, nominal)
    some_known = any(rows.targets[k].spanning_mm is not None for k in np.unique(rows.target[inlier]))
    if (missing is None or some_known) and growth < MOST_GROWTH and worst < MOST_ERROR_MM:
        return
    refuse(missing or TOO_LITTLE, worst)


def refuse_collapse(rows: UnplacedRows, scale: float) -> None:
    """Refuse an answer whose image is a point, which is what a scale that nothing holds comes to.

    Raises:
        DegenerateGeometryError: it is; which motion is missing.
    """
    extent_mm = scale * float(np.ptp(rows.points, axis=0).max())
    if not extent_mm > LEAST_EXTENT_MM:
        refuse(missing_motion(rows, np.ones(len(rows.points), dtype=bool)) or SCALE, np.inf)


def refuse_missing(rows: UnplacedRows) -> None:
    """Refuse rows none of whose targets is known, and whose motion lacks something that has a name.

    Raises:
        DegenerateGeometryError: which motion is missing.
    """
    missing = missing_motion(rows, np.ones(len(rows.points), dtype=bool))
    if missing is not None and all(rows.targets[k].spanning_mm is None for k in np.unique(rows.target)):
        refuse(missing, np.inf)


def refuse(missing: tuple[str, str], worst_mm: float) -> NoReturn:
    """Say which motion is missing.

    Raises:
        DegenerateGeometryError: always.
    """
    said, code = missing
    error = f"{worst_mm:.2g} mm" if worst_mm < MOST_SAID_MM else "any size"
    raise DegenerateGeometryError(
        f"the target's place is not known, and {said}: errors of {error} at a corner of what was seen would not show "
        "in the residuals; tilt the probe by 30 to 40 degrees to both sides about two axes and turn it about the "
        "vertical, seeing the target all over the image",
        f"unplaced-{code}",
    )


def turns_deg(rotations: Array) -> Array:
    """(3,): root mean square turns about their mean, about the axis of the largest, the second, the least."""
    if len(rotations) < 2:
        return np.zeros(3)
    u, _, vt = np.linalg.svd(rotations.mean(axis=0))
    mean = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    from scipy.spatial.transform import Rotation

    relative = np.einsum("ji,njk->nik", mean, rotations)
    vectors = Rotation.from_matrix(relative).as_rotvec(degrees=True)
    return np.asarray(np.sqrt(np.linalg.eigvalsh(vectors.T @ vectors / len(vectors)).clip(0))[::-1])


def missing_motion(rows: UnplacedRows, agreeing: NDArray[np.bool_]) -> tuple[str, str] | None:
    """What the probe did not do, and the code of that; None where it did all."""
    turns, spread_px = turns_deg(rows.poses[agreeing, :, :3]), _spread_px(rows, agreeing)
    if turns[0] < LEAST_TURN_DEG:
        return f"the probe hardly turned ({turns[0]:.1f} degrees)", "translation"
    if turns[1] < LEAST_TURN_DEG:
        return (
            f"the probe turned about one axis only ({turns[0]:.0f} degrees about it, {turns[1]:.1f} about any other)",
            "one-axis",
        )
    if spread_px < LEAST_SPREAD_PX:
        return (
            f"it stays at one place of the image (within {spread_px:.2g} px): the scale is free",
            "pivot",
        )
    return None


def _spread_px(rows: UnplacedRows, agreeing: NDArray[np.bool_]) -> float:
    points = rows.points[agreeing, : rows.dimension]
    if len(points) < 2:
        return 0.0
    return float(np.sqrt(np.linalg.eigvalsh(np.cov(points.T)).clip(0)[-2]))


def _worst_mm(rows: UnplacedRows, transform: AxisScaled, nominal: Array) -> float:
    if not np.isfinite(nominal).all():
        return np.inf
    tangent = 7 if isinstance(transform, Similarity) else 8
    low, high = rows.points.min(axis=0), rows.points.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)
    return float(radius_95(point_covariance(transform, nominal[:tangent, :tangent], corners)).max())
