"""The lag between image and tracker as one more unknown beside the transform, and how well it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import DegenerateGeometryError
from sonocal.geometry import Array, AxisScaled
from sonocal.registration.fit import Fit
from sonocal.registration.image_distortion import side_by_side
from sonocal.registration.mapped import MappedRows
from sonocal.registration.options import Options
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.uncertainty import point_jacobian, quantile_95
from sonocal.registration.whitened import whitened
from sonocal.setup_checks.motion import FEWEST_FRAMES
from sonocal.setup_checks.rows_in_time import RowsInTime, ShiftedRows

__all__ = ["LagFit", "fit_lag"]

MOST_STEPS, MOST_STEP_S, AT_REST_S = 30, 0.02, 1e-8
# Stretches of the scan, each left out in turn: errors that go together over less than one are counted.
STRETCHES = 12
# Of what velocities say of the lag beside the transform, the share that their own noise may be.
MOST_BY_NOISE = 0.5
# And the least share of what they say at all: the rest looks like a motion of the transform.
LEAST_TOLD = 1e-6
# An interval (95 %) that is wider than this to either side tells nothing; where it shows that there is a lag, one that
# is wider than the other.
WIDEST_S, WIDEST_OF_A_LAG_S = 0.05, 0.15
ADVICE = (
    "move the needle through the image to and fro for 20 s, at some 40 mm/s and in more than one direction, and record "
    "again; or give the lag in seconds"
)


@dataclass(frozen=True, eq=False)
class LagFit:
    """The lag under which the rows agree best, fitted with the transform.

    Attributes:
        latency_s: how much later the tracker stamps an instant than the images do.
        deviation_s: its standard deviation, over stretches of the scan left out in turn.
        freedom: of Student's t that it has.
        moved: (k,), by how much the transform's tangent follows the lag, a second.
        change_s: how much later the lag is at the scan's end than at its begin, were it to change evenly.
        change_deviation_s: of that.
        speed_mm_s: of the needle where it is seen, across itself, rms.
        fit: the transform under the lag.
    """

    latency_s: float
    deviation_s: float
    freedom: int
    moved: Array
    change_s: float
    change_deviation_s: float
    speed_mm_s: float
    fit: Fit

    @property
    def half_width_s(self) -> float:
        """Of the 95 % interval."""
        return quantile_95(self.freedom) * self.deviation_s

    @property
    def interval_s(self) -> tuple[float, float]:
        """The 95 % interval."""
        return self.latency_s - self.half_width_s, self.latency_s + self.half_width_s

    @property
    def covariance(self) -> Array:
        """(k, k): what the lag's own uncertainty adds to the transform's; Student's t has this variance."""
        variance = self.deviation_s**2 * self.freedom / (self.freedom - 2.0)
        return variance * np.outer(self.moved, self.moved)


def fit_lag(rows: RowsInTime, start: AxisScaled, lag: float, options: Options, threshold_mm: float) -> LagFit:
    """The lag that a scan tells, by Gauss-Newton with the transform from where both are nearly right.

        r_i = P_i (A x_i - X_i(t_i + lag)),   dr_i = P_i (J_i d - V_i dlag)

    X_i is the line's point that is seen, V_i its velocity in the probe's frame, P_i what is across the line. Rows are
    weighed as the likelihood weighs them. Whatever errs over less than a twelfth of the scan is in the deviation.

    Args:
        rows: and where their lines are at any lag, s.
        start: of the transform.
        lag: to start from, s.
        options: how rows are weighed.
        threshold_mm: rows within this distance agree.

    Raises:
        DegenerateGeometryError: the lines do not move, or as one with the transform, so that no lag shows.
    """
    for _ in range(MOST_STEPS):
        shifted = rows.shifted(lag)
        mapped = MappedRows(start, shifted.lines)
        fit = refine_point_lines(start, shifted.lines, _agreeing(mapped, threshold_mm), options)
        sums = _Sums.of(shifted, fit)
        step = float(np.clip(sums.solved()[-1], -MOST_STEP_S, MOST_STEP_S))
        if abs(step) < AT_REST_S:
            break
        start, lag = fit.transform, lag + step
    found = sums.lag(lag, fit)
    if found.half_width_s > (WIDEST_OF_A_LAG_S if abs(lag) > found.half_width_s else WIDEST_S):
        raise _untold(
            f"the scan tells the lag to +-{1e3 * found.half_width_s:.0f} ms only (95 %), at a usual speed of the "
            f"needle across itself of {found.speed_mm_s:.2g} mm/s"
        )
    return found


def _untold(why: str) -> DegenerateGeometryError:
    return DegenerateGeometryError(f"{why}; {ADVICE}", "lag-untold")


def _agreeing(mapped: MappedRows, threshold_mm: float) -> NDArray[np.bool_]:
    """The rows that agree.

    Raises:
        DegenerateGeometryError: they are of too few frames.
    """
    agreeing = mapped.distances <= threshold_mm
    assert mapped.table.frame is not None
    if (frames := len(np.unique(mapped.table.frame[agreeing]))) < FEWEST_FRAMES:
        raise _untold(f"a lag needs sightings that agree in {FEWEST_FRAMES} images and has them in {frames}")
    return agreeing


@dataclass(frozen=True, eq=False)
class _Sums:
    """Products of the derivatives by tangent and lag, of the lag's change and of the residuals, over stretches.

    Attributes:
        products: (G, k + 3, k + 3).
        by_noise: (G, 3, 3): of lag, change and residual, what the velocities' noise makes of their products.
        speed_mm_s: of the lines, rms.
    """

    products: Array
    by_noise: Array
    speed_mm_s: float

    @classmethod
    def of(cls, shifted: ShiftedRows, fit: Fit) -> _Sums:
        """Of rows under a lag and the transform fitted to them."""
        mapped = MappedRows(fit.transform, shifted.lines)
        chosen, k = side_by_side(mapped, fit.inlier), len(fit.covariance)
        assert shifted.table.frame is not None
        frame = np.unique(shifted.table.frame[chosen], return_inverse=True)[1].reshape(-1)
        place = (frame + 0.5) / (frame.max() + 1) - 0.5
        shares = mapped.shares[chosen]
        velocity = np.einsum("nk,nki->ni", shares, shifted.moved.velocities[chosen])
        columns = np.concatenate(
            [
                -point_jacobian(fit.transform, shifted.table.points[chosen], k),
                velocity[:, :, None],
                (place[:, None] * velocity)[:, :, None],
                np.broadcast_to(np.eye(3), (len(chosen), 3, 3)),
                mapped.residuals[chosen][:, :, None],
            ],
            axis=2,
        )
        white = whitened(mapped, chosen, columns, fit.levels)
        axes = white[:, :, k + 2 : k + 5]
        white = np.delete(white, np.s_[k + 2 : k + 5], axis=2)
        ends_noise = shifted.moved.unrest[chosen] * np.sum(shares**2, axis=1)
        noise = ends_noise * np.einsum("nij,nij->n", axes, axes)
        form = np.stack([np.ones(len(place)), place, np.zeros(len(place))], axis=1)
        stretch = np.eye(STRETCHES)[frame * STRETCHES // (frame.max() + 1)]
        across = mapped.across(chosen, velocity[:, :, None])[:, :, 0]
        return cls(
            np.einsum("ng,nai,naj->gij", stretch, white, white, optimize=True),
            np.einsum("ng,n,ni,nj->gij", stretch, noise, form, form, optimize=True),
            float(np.sqrt(np.mean(np.sum(across**2, axis=1)))),
        )

    def solved(self, *, left_out: int | None = None, changing: bool = False) -> Array:
        """(k + 1,), or with its change (k + 2,): the step of tangent and lag, of all stretches but one."""
        kept = np.delete(np.arange(len(self.products)), [] if left_out is None else left_out)
        sums = self.products[kept].sum(axis=0)
        sums[-3:, -3:] -= self.by_noise[kept].sum(axis=0)
        if not changing:
            sums = np.delete(np.delete(sums, -2, axis=0), -2, axis=1)
        information, pull = sums[:-1, :-1], sums[:-1, -1]
        size = 1.0 / np.sqrt(np.maximum(np.diagonal(information), np.finfo(float).tiny))
        scaled = information * size[:, None] * size
        return np.asarray(np.linalg.lstsq(scaled, pull * size, rcond=1e-12)[0] * size)

    def lag(self, latency_s: float, fit: Fit) -> LagFit:
        """The lag with what is known of it, at the rest.

        Raises:
            DegenerateGeometryError: what velocities say beside the transform may be their noise.
        """
        sums, k = self.products.sum(axis=0), len(fit.covariance)
        moved = np.linalg.lstsq(sums[:k, :k], sums[:k, k], rcond=None)[0]
        told = float(sums[k, k] - sums[k, :k] @ moved)
        noise = float(self.by_noise[:, 0, 0].sum())
        if not told > max(noise / MOST_BY_NOISE, LEAST_TOLD * float(sums[k, k])):
            raise _untold(
                f"the motion tells no lag: the needle's speed across itself is {self.speed_mm_s:.2g} mm/s, alike "
                "throughout or no more than noise"
            )
        lags = np.array([self.solved(left_out=one)[-1] for one in range(STRETCHES)])
        changes = np.array([self.solved(left_out=one, changing=True)[-1] for one in range(STRETCHES)])
        return LagFit(
            latency_s=float(latency_s),
            deviation_s=_deviation(lags),
            freedom=STRETCHES - 1,
            moved=-moved,
            change_s=float(self.solved(changing=True)[-1]),
            change_deviation_s=_deviation(changes),
            speed_mm_s=self.speed_mm_s,
            fit=fit,
        )


def _deviation(folds: Array) -> float:
    """The standard deviation of what came of all stretches but one, each in turn (jackknife)."""
    return float(np.sqrt((len(folds) - 1) / len(folds) * np.sum((folds - folds.mean()) ** 2)))
