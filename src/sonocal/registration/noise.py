"""How large the errors are, and which of them rows share."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import Array, AxisScaled
from sonocal.registration.fit import Fit, away_from_lines
from sonocal.registration.rows import PointLineRows, to_core
from sonocal.registration.target_rows import TargetRows

__all__ = ["Drift", "Noise", "estimate_noise", "residual_vectors", "stretch_length"]

# The place of the rows' own variance beside those of groupings, which count from 0.
OWN = -1
# Of a covariance; the core takes no larger one, and no such one means anything.
MOST = 1e60


@dataclass(frozen=True)
class Drift:
    """An offset of the lines that wanders from frame to frame and that neighbouring frames share.

    Attributes:
        memory_frames: frames after which its correlation has fallen to 1 / e.
        stretches: as many independent errors it has shown.
        gain: twice the logarithm of how much likelier it makes the residuals; by chance 10 in some sound scans of a
            thousand.
    """

    memory_frames: float
    stretches: float
    gain: float


@dataclass(frozen=True)
class Noise:
    """Standard deviations per axis, and what they do to the tangent.

    Attributes:
        row_mm: of the distance to the line, from errors independent from row to row; NaN where no row is to
            spare.
        covariance: (k, k), of the tangent.
        freedom: as many residuals to spare would make a known weighting as sure as this covariance is.
        sigma_px: of an image point, px, where the weights are the likelihood's; else None.
        sigma_mm: of a segment's end point, mm; likewise.
        apparent: of what the rows seem to say of the motion that they hold least, how much noise alone may have given:
            from 0; at 1 nothing else need be there.
        shared_mm: by grouping ("frame", "target", "stretch"), of an offset that all rows of a group share. A
            grouping that the data cannot tell from the rest is absent.
        drift: what is shared by stretches of frames; None where neighbours have nothing in common.
    """

    row_mm: float
    covariance: Array
    freedom: int
    sigma_px: float | None = None
    sigma_mm: float | None = None
    apparent: float = 0.0
    shared_mm: dict[str, float] = field(default_factory=dict)
    drift: Drift | None = None


def residual_vectors(transform: AxisScaled, points: Array, segments_mm: Array) -> Array:
    """(N, 3), mm: from each line to its mapped point, at right angles to the line."""
    return away_from_lines(transform.apply(points), segments_mm)


def estimate_noise(
    rows: PointLineRows | TargetRows,
    fit: Fit,
    groupings: dict[str, NDArray[Any]],
    *,
    time: Array | None = None,
    known_px: bool = False,
    known_mm: bool = False,
) -> Noise:
    """Noise of the rows and of their groups, and the tangent's covariance under it.

    A wire that is 0.3 mm off is off in every frame: hundreds of rows on nine wires are nearer to nine
    measurements than to hundreds. With residuals made independent and of unit variance under the fit's
    weights, each is taken as the sum of its own noise and of one offset for each group that it is in,

        r = J d + e + sum_g B_g b_g

    and the variances of e and b_g are those that make the sums of squares, total and between groups, equal
    to their expectations after the fit has taken its part (analysis of variance with the fit's 7 or 8
    parameters as covariates). Neighbouring frames may share an offset that wanders: an autoregression of the first
    order, by restricted maximum likelihood, whose shape says how many independent errors there were.

    Noise is in J, too. An answer that is freed of its pull (`fit_point_lines`) is less sure than J'J says, which
    holds the noise's square; that is taken out, and what is unknown of the levels' ratio is added.

    Args:
        rows: points and lines, or whatever targets.
        fit: of which only the agreeing rows count.
        groupings: by name: (N,) the group of each row, a number from 0 on.
        time: (N,), one a frame, neighbouring frames some 1 apart; None: nothing is shared by neighbours.
        known_px: the image points' noise level was given. Residuals smaller than two given levels say do not
            shrink the covariance; levels estimated from the same residuals make it larger and less sure.
        known_mm: the segments' noise level was given; likewise.

    Returns:
        The noise and the covariance.

    Source: Henderson's method 3 (Searle, Casella and McCulloch, Variance Components, 1992, chapter 5).
    """
    k = len(fit.covariance)
    freedom = rows.residuals(fit.inlier) - k
    weighted = fit.weighting == "likelihood"
    sigma_px, sigma_mm = (fit.sigma_px, fit.sigma_mm) if weighted else (None, None)
    if freedom <= 0 or not np.abs(fit.covariance).max() < MOST:
        return Noise(np.nan, np.full((k, k), np.nan), 0, sigma_px, sigma_mm)
    sums = _core.noise_sums(
        rows.core,
        rows.marks(fit.inlier),
        to_core(fit.transform),
        fit.options.to_core(fit.sigma_px, fit.sigma_mm),
        _of_tangent(rows, fit.covariance),
        [rows.codes(labels) for labels in groupings.values()],
        known_px=known_px,
        known_mm=known_mm,
        time=None if time is None else rows.times(time),
    )
    variances = _with_drift(_variances(sums), sums, list(groupings))
    unit, total = variances.pop(OWN), float(sums.observed[0])
    if weighted and known_px and known_mm:
        unit = max(unit, 1.0)
    covariance = unit * sums.covariance
    for place, variance in variances.items():
        covariance = covariance + variance * sums.of_offsets[place]
    drift = sums.drift
    if drift.gain > 0:
        covariance = covariance + drift.unit * drift.of_offsets
        # Student's t of few freedom has this variance, and nearly the normal's 95 % in units of it.
        covariance = covariance * drift.freedom / (drift.freedom - 2.0)
    covariance = sums.widening @ covariance @ sums.widening.T + np.outer(sums.moved, sums.moved)
    squares = float(fit.residuals_mm[fit.inlier] @ fit.residuals_mm[fit.inlier]) / freedom
    row_mm = sqrt(squares * unit * freedom / total) if total > 0 else 0.0
    apparent = sums.apparent if weighted else _apparent_of_unweighted(rows, fit, row_mm)
    names = list(groupings)
    shared_mm = {names[sums.kept[place]]: sqrt(variance) for place, variance in variances.items()}
    wandering = None
    if drift.gain > 0:
        shared_mm["stretch"] = sqrt(drift.wander * drift.unit)
        wandering = Drift(drift.memory, drift.stretches, drift.gain)
    # One level alone leaves a whole number to rounding: 5 must not come out as 4.
    whole = int(min(freedom, sums.freedom * (1.0 + 1e-9)))
    return Noise(row_mm, covariance, whole, sigma_px, sigma_mm, apparent, shared_mm, wandering)


def _of_tangent(rows: PointLineRows | TargetRows, covariance: Array) -> Array | None:
    """(J'J)^-1, which the core finds of a mix itself: a fit's covariance has more in it."""
    return covariance if isinstance(rows, PointLineRows) else None


def _apparent_of_unweighted(rows: PointLineRows | TargetRows, fit: Fit, row_mm: float) -> float:
    """Of a fit that knows no levels: such as give residuals of this size (mm per axis), whatever their ratio.

    Twice: nothing takes the noise's pull out of such a fit.
    """
    if not row_mm > 0:
        return 0.0
    levels = row_mm / (sqrt(2.0) * float(fit.transform.scales.mean())), row_mm
    options = replace(fit.options, weighting="likelihood").to_core(*levels)
    covariance = row_mm**2 * fit.covariance
    return (
        2
        * _core.noise_sums(
            rows.core,
            rows.marks(fit.inlier),
            to_core(fit.transform),
            options,
            _of_tangent(rows, covariance),
            [],
            known_px=False,
            known_mm=False,
        ).apparent
    )


def stretch_length(residuals: Array, frame: NDArray[Any]) -> int:
    """Over how many consecutive frames the frames' mean residuals repeat one another.

    Twice the sum of the positive autocorrelations up to the first that noise could give, plus one: the
    number of frames that carry as much information as one independent frame.

    Args:
        residuals: (N, 3), mm.
        frame: (N,): the frame of each row, numbers in the order of time.

    Returns:
        Frames; 1 where neighbouring frames have nothing in common.

    Source: integrated autocorrelation time (Sokal 1997, section 3).
    """
    return _core.stretch_length(
        np.ascontiguousarray(residuals, dtype=float), np.ascontiguousarray(frame, dtype=np.int32)
    )


def _with_drift(variances: dict[int, float], sums: _core.NoiseSums, names: list[str]) -> dict[int, float]:
    """The variances where a drift was found: it says what is left to single rows, and what it has of single frames."""
    if not sums.drift.gain > 0:
        return variances
    others = {
        place: one for place, one in variances.items() if place == OWN or names[sums.kept[place]] != "frame"
    }
    return others | {OWN: sums.drift.unit}


def _variances(sums: _core.NoiseSums) -> dict[int, float]:
    """The rows' own variance (OWN) and groups' that match the observed sums of squares; negative ones count as none."""
    chosen = list(range(len(sums.kept)))
    while chosen:
        places = [0, *(place + 1 for place in chosen)]
        expected = sums.expected[np.ix_(places, places)]
        # Columns have unlike units: without this, a cut-off of small singular values would depend on them.
        size = np.abs(expected).max(axis=0)
        solved = np.linalg.lstsq(expected / size, sums.observed[places], rcond=1e-9)[0] / size
        if np.all(solved[1:] >= 0):
            shared = dict(zip(chosen, map(float, solved[1:]), strict=True))
            return {OWN: max(float(solved[0]), 0.0)} | shared
        chosen.pop(int(np.argmin(solved[1:] * size[1:])))
    return {OWN: float(sums.observed[0] / sums.expected.flat[0])}
