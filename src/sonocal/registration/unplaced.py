"""Targets whose place nobody knows: found with the similarity, from how a tracked sensor moved about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal import _core
from sonocal.errors import DegenerateGeometryError, NoConsensusError, UnsupportedError
from sonocal.geometry import Array, AxisScaled, Similarity
from sonocal.geometry.shown import brief
from sonocal.registration.options import Model, one_of, positive_number, whole_number
from sonocal.registration.uncertainty import NORMAL_95
from sonocal.registration.unplaced_motion import refuse_collapse, refuse_missing, refuse_motion
from sonocal.registration.unplaced_rows import SIGMA_MM, SIGMA_PX, UnplacedRows, UnplacedTarget
from sonocal.registration.unplaced_search import Found, find, find_under_lag
from sonocal.registration.unplaced_time import PosesInTime

__all__ = ["Place", "Placed", "UnplacedTarget", "register_unplaced"]

# Of a lag, to either side (95 %).
LONGEST_DOUBT_S = 0.05
# In units of variance: another answer that costs no more than this more fits as well.
AS_WELL = 9.0


@dataclass(frozen=True, eq=False)
class Place:
    """Where a target was found, in its own frame.

    Attributes:
        kind: "point", "line" or "plane".
        middle_mm: (3,): of it, next to what was seen.
        direction: (3,): of a line, or the normal of a plane; None of a point.
        axes: (3, 3): columns; those at right angles to the target first.
        covariance: (3, 3), (4, 4), (3, 3): of shifts along the columns at right angles (mm), then of turns of each of
            these towards each of the others (rad); None where the place was known exactly.
    """

    kind: str
    middle_mm: Array
    direction: Array | None
    axes: Array
    covariance: Array | None

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Placed:
    """A similarity, and the places of targets that it was found with.

    Attributes:
        marker_from_source: mm from px.
        covariance: (k, k), of its tangent, with the noise estimated.
        nominal_covariance: likewise, with noise not less than expected of the tracker and the images.
        places: of each target.
        lag_s: by how much later poses are stamped than images; None where that was not asked for.
        lag_sigma_s: its standard deviation.
        sigma_px, sigma_mm: noise of an image point, and of a pose's translation, along every axis.
        freedom: residuals to spare.
        residuals_mm: (N,): of each row from its target; NaN where the lag leads beyond what is known.
        inlier: (N,): those that agree.
        alternatives: other answers that fit as well, mm from px.
    """

    marker_from_source: AxisScaled
    covariance: Array
    nominal_covariance: Array
    places: tuple[Place, ...]
    lag_s: float | None
    lag_sigma_s: float | None
    sigma_px: float
    sigma_mm: float
    freedom: int
    residuals_mm: Array
    inlier: NDArray[np.bool_]
    alternatives: tuple[AxisScaled, ...] = ()

    __repr__ = brief


def register_unplaced(
    points: ArrayLike,
    marker_from_body: ArrayLike,
    targets: Sequence[UnplacedTarget],
    *,
    target: ArrayLike | None = None,
    frame: ArrayLike | None = None,
    time_s: ArrayLike | None = None,
    start: Similarity | None = None,
    model: Model = "similarity",
    threshold_mm: float = 5.0,
    sigma_px: float | None = None,
    sigma_mm: float | None = None,
    max_samples: int = 400,
    seed: int = 0,
    trusted: bool = False,
) -> Placed:
    """The similarity from a source to a moving marker, and the places of what it saw.

    Every row is a point of the source that lies on a target:

        N' (T_i^-1 A x_i - p) = 0        T_i: the marker from the target's body, A the similarity, (N, p) the place

    With the directions N given the rest is linear, but for S being that of a similarity: samples of frames against
    directions of the half sphere, refined and scored on all rows. Then the likelihood, with noise of the points and of
    the poses, which rows of a frame share.

    Args:
        points: (N, 2) or (N, 3), px.
        marker_from_body: (N, 4, 4), rigid, mm: the pose of each row's target in the marker's frame, at its instant.
        targets: what was seen; at least one whose place is not known.
        target: (N,): which of them each row is of; default: the first.
        frame: (N,): rows of one instant share a number, and the noise of its poses; default: each its own.
        time_s: (N,): when each row's image was taken: then poses are stamped later by a lag that is asked for, too.
        start: near the answer; default: from nothing.
        model: "anisotropic": a scale along u and one along v, of 2D images.
        threshold_mm: rows within this distance agree, in the search.
        sigma_px: noise of an image point along every axis, where known.
        sigma_mm: noise of a pose's translation along every axis, where known; it turns by 0.2 degrees for 0.3 mm.
        max_samples: random samples at the most.
        seed: of the random samples.
        trusted: return an answer though the motion leaves something of it open.

    Raises:
        InputError: shapes differ, a pose is not rigid, or an option means nothing.
        DegenerateGeometryError: the motion cannot give the answer; the sentence says which is missing.
        UnsupportedError: two scales of a volume.
        NoConsensusError: nothing agrees with enough rows.

    Source: section 5.1 of the paper, with the target's place as further unknowns.
    """
    rows = UnplacedRows.of(points, marker_from_body, targets, target, frame)
    levels = (
        SIGMA_PX if sigma_px is None else positive_number("sigma_px", sigma_px),
        SIGMA_MM if sigma_mm is None else positive_number("sigma_mm", sigma_mm),
    )
    scales = _scales(model, rows)
    how = {
        "scales": scales,
        "level_px": levels[0],
        "level_mm": levels[1],
        "levels_known": sigma_px is not None and sigma_mm is not None,
        "threshold_mm": positive_number("threshold_mm", threshold_mm),
        "max_samples": whole_number("max_samples", max_samples, 1, 1 << 30),
        "seed": whole_number("seed", seed, 0, 2**64 - 1),
    }
    found = (
        find(rows, start, how) if time_s is None else find_under_lag(PosesInTime.of(rows, time_s), start, how)
    )
    if not found.answers:
        refuse_missing(rows)
        raise NoConsensusError(
            "no calibration and no place of the target agree with the rows; check that they are of one target",
            best_count=0,
        )
    best = found.answers[0]
    refuse_collapse(rows, float(best.scales[0]))
    if not trusted:
        refuse_motion(found.rows, best.inlier, _transform(best, scales), best.nominal, best.growth)
    return _with_lag_told(_placed(rows, found, scales))


def _scales(model: Model, rows: UnplacedRows) -> int:
    if one_of("model", model, ("similarity", "anisotropic")) == "similarity":
        return 1
    if rows.dimension == 3:
        raise UnsupportedError("the anisotropic model is for 2D images; take the similarity for a volume's")
    return 2


def _placed(rows: UnplacedRows, found: Found, scales: int) -> Placed:
    best = found.answers[0]
    others = [other for other in found.answers[1:] if other.cost < best.cost + AS_WELL]
    of_calibration, asked_lag = 6 + scales, found.with_lag is not None
    covariance_of_all = best.covariance if found.with_lag is None else found.with_lag
    places, at = [], of_calibration + asked_lag
    for k, target in enumerate(rows.targets):
        free = 0 if target.known else (3, 4, 3)[target.spans - 1]
        along = {1: None, 2: best.axes[k][:, 2], 3: best.axes[k][:, 0]}[target.spans]
        covariance = covariance_of_all[at : at + free, at : at + free] if free else None
        places.append(Place(target.kind, best.bases[k], along, best.axes[k], covariance))
        at += free
    calibration = slice(0, of_calibration)
    return Placed(
        _transform(best, scales),
        covariance_of_all[calibration, calibration],
        best.nominal[calibration, calibration],
        tuple(places),
        found.lag_s,
        float(np.sqrt(covariance_of_all[of_calibration, of_calibration])) if asked_lag else None,
        best.level_px,
        best.level_mm,
        int(best.freedom),
        rows.in_order(_of_all(best.distances, found.known, np.nan)),
        rows.in_order(_of_all(best.inlier, found.known, False)),
        tuple(_transform(other, scales) for other in others),
    )


def _with_lag_told(placed: Placed) -> Placed:
    if placed.lag_sigma_s is not None and not NORMAL_95 * placed.lag_sigma_s < LONGEST_DOUBT_S:
        raise DegenerateGeometryError(
            f"the motion tells the lag to +-{1e3 * NORMAL_95 * placed.lag_sigma_s:.0f} ms only; scan for longer, "
            "without stops, or give the lag",
            "lag-untold",
        )
    return placed


def _of_all(values: NDArray[Any], known: NDArray[np.bool_], absent: Any) -> NDArray[Any]:
    out = np.full(len(known), absent, dtype=values.dtype)
    out[known] = values
    return out


def _transform(found: _core.FoundPlaces, scales: int) -> AxisScaled:
    if scales == 1:
        return Similarity(found.rotation, found.translation, float(found.scales[0]))
    return AxisScaled(found.rotation, found.translation, found.scales)
