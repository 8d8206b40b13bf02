"""A model against a wider one of which it is a case: a known scale against a free one, one scale against several."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from sonocal.geometry import Array, AxisScaled
from sonocal.geometry.shown import brief
from sonocal.registration.best_fit import refined_fit
from sonocal.registration.fit import Fit
from sonocal.registration.free_scale import freely_scaled
from sonocal.registration.mapped import mapped_rows
from sonocal.registration.noise import Noise
from sonocal.registration.options import Model, unknowns
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows
from sonocal.registration.uncertainty import point_jacobian, quantile_95

__all__ = ["SURE", "ModelTest", "model_tests", "tested"]

# What lies as far out as three standard deviations is no chance. What few independent errors leave unknown is in a
# drift's covariance already, and of that the user is warned.
SURE, SURE_BESIDE_DRIFT = 0.0027, 0.05
# The rows that agree with a model may be few where it is wrong: those that agree with the wider one are fitted again.
ROUNDS = 2
# Of rows of which fewer agree with a known scale, others may agree with a free one.
FEW = 0.7


@dataclass(frozen=True)
class ModelTest:
    """Whether rows tell a model from a wider one.

    The logarithms of the wider model's scales, less what the narrower one says of them, against their covariance under
    all errors that were found, also those that rows share:

        F = d' (C V C')^-1 d / q        d = C (log scales - those of the narrower model)

    Where nothing is shared it is the likelihood ratio's F, (S_narrow - S_wide) / (q s^2), to first order.

    Attributes:
        narrower, wider: the models.
        narrower_mm_per_px: the narrower one's scale; the wider one's mean where nothing was fitted by one.
        wider_mm_per_px: the wider one's, one or one along every axis.
        f_statistic: F of `contrasts` (q) and `freedom`, where the narrower model holds.
        p_value: how often that is larger by chance.
        level: the p-value below which it is none.
        apart: by how much they differ at the most, a share: the wider one's over the narrower one's, or over its own
            others, less one.
        apart_95: the 95 % uncertainty of that.
        apart_mm: how far the two models' places of the image are apart at most.
        unsure_mm: how far the wider one's are unsure by what it has more, 95 %.

    Source: Wald 1943; Rao and Scott 1984 of errors that rows share.
    """

    narrower: Model
    wider: Model
    narrower_mm_per_px: float
    wider_mm_per_px: tuple[float, ...]
    f_statistic: float
    contrasts: int
    freedom: float
    p_value: float
    level: float
    apart: float
    apart_95: float
    apart_mm: float
    unsure_mm: float

    __repr__ = brief

    @property
    def contradicts(self) -> bool:
        """Whether the rows contradict the narrower model."""
        return self.p_value < self.level

    @property
    def odd_axis(self) -> int:
        """The axis whose scale is furthest from the others'; of a volume or an image with several."""
        logs = np.log(self.wider_mm_per_px)
        return int(np.argmax(np.abs(logs - np.mean(logs))))


def model_tests(
    table: PointLineRows | TargetRows, fit: Fit, noise_of: Callable[[Fit], Noise], places: Array
) -> tuple[ModelTest, ...]:
    """The fit's model against others: a known scale against a free one, one scale against one along every axis.

    Args:
        table: the rows.
        fit: of any model.
        noise_of: the noise of a fit of theirs, with all that rows may share.
        places: (M, d), px, where the models are compared.

    Returns:
        One or two; none where too few rows agree.
    """
    return tuple(_tests(table, fit, noise_of, places))


def _tests(
    table: PointLineRows | TargetRows, fit: Fit, noise_of: Callable[[Fit], Noise], places: Array
) -> Iterator[ModelTest]:
    if table.residuals(fit.inlier) <= unknowns("anisotropic", table.dimension):
        return
    one = fit
    if fit.model == "rigid":
        one = _free(table, fit) or _wider(table, fit, "similarity")
        yield from _if_sound(one, noise_of(one), fit, places)
    if fit.model == "anisotropic":
        several, one = (
            fit,
            refined_fit(fit.transform, table, fit.inlier, fit.levelled.of_model("similarity")),
        )
    else:
        several = _wider(table, one, "anisotropic")
    yield from _if_sound(several, noise_of(several), one, places)


def _free(table: PointLineRows | TargetRows, fit: Fit) -> Fit | None:
    """The fit of a free scale by other rows than agree with the known one, where these are few."""
    agreeing = int(np.count_nonzero(fit.inlier))
    return freely_scaled(table, fit.options, agreeing) if agreeing < FEW * len(table) else None


def _wider(table: PointLineRows | TargetRows, fit: Fit, model: Model) -> Fit:
    """The rows that agree by a wider model, and those that agree with that."""
    options, chosen = fit.levelled.of_model(model), fit.inlier
    found = refined_fit(fit.transform, table, chosen, options)
    for _ in range(ROUNDS):
        mapped = mapped_rows(found.transform, table)
        agreeing = table.within(mapped.distances, fit.threshold_mm)
        if np.count_nonzero(agreeing & ~chosen) == 0:
            break
        chosen = chosen | agreeing
        found = refined_fit(found.transform, table, chosen, options)
    return found


def _if_sound(wider: Fit, noise: Noise, narrower: Fit, places: Array) -> Iterator[ModelTest]:
    """The test, where the wider model came to rest with a covariance."""
    if wider.converged and np.isfinite(noise.covariance).all() and noise.freedom > 0:
        yield from tested(
            (narrower.model, narrower.transform),
            (wider.model, wider.transform),
            noise.covariance,
            (noise.freedom, SURE if noise.drift is None else SURE_BESIDE_DRIFT),
            places,
        )


def tested(
    narrower: tuple[Model, AxisScaled],
    wider: tuple[Model, AxisScaled],
    covariance: Array,
    sure: tuple[float, float],
    places: Array,
) -> Iterator[ModelTest]:
    """The test of two fits; none where rounding is all that is left of the covariance.

    Args:
        narrower: model and its fit, mm from px.
        wider: likewise.
        covariance: (k, k), of the wider one's tangent.
        sure: residuals to spare behind it, and the p-value that is no chance.
        places: (M, d), px, where the two are compared.
    """
    from scipy.special import fdtrc

    freedom, level = sure
    scales = wider[1].scales[: len(covariance) - 6]
    contrasts = np.ones((1, 1)) if len(scales) == 1 else np.diff(np.eye(len(scales)), axis=0)
    logs = np.log(scales / narrower[1].scales[0])
    spread = covariance[6:, 6:]
    of_contrasts = contrasts @ spread @ contrasts.T
    if not np.linalg.eigvalsh(of_contrasts)[0] > 0:
        return
    off = contrasts @ logs
    f = float(off @ np.linalg.solve(of_contrasts, off)) / len(contrasts)
    against = _most_off(logs)
    apart, deviation = float(against @ logs), float(np.sqrt(against @ spread @ against))
    moved = wider[1] @ places - narrower[1] @ places
    yield ModelTest(
        narrower=narrower[0],
        wider=wider[0],
        narrower_mm_per_px=float(narrower[1].scales[0]),
        wider_mm_per_px=tuple(scales.tolist()),
        f_statistic=f,
        contrasts=len(contrasts),
        freedom=float(min(freedom, 2**31)),
        p_value=float(fdtrc(len(contrasts), freedom, f)),
        level=level,
        apart=float(np.expm1(apart)),
        apart_95=quantile_95(freedom) * deviation,
        apart_mm=float(np.linalg.norm(moved, axis=-1).max()),
        unsure_mm=quantile_95(freedom) * _unsure(wider[1], covariance, contrasts, places),
    )


def _most_off(logs: Array) -> Array:
    """What is furthest off, as a contrast: of one scale itself, of two u over v, of three one over the others."""
    if len(logs) < 3:
        return np.array([1.0, -1.0][: len(logs)])
    odd = int(np.argmax(np.abs(logs - logs.mean())))
    return np.where(np.arange(3) == odd, 1.0, -0.5)


def _unsure(transform: AxisScaled, covariance: Array, contrasts: Array, places: Array) -> float:
    """How far, mm, a standard deviation of the contrasts moves a place at most, all else following."""
    by_contrasts = covariance[:, 6:] @ contrasts.T
    of_contrasts = contrasts @ covariance[6:, 6:] @ contrasts.T
    jacobian = point_jacobian(transform, places, len(covariance)) @ by_contrasts  # (M, 3, q)
    spread = jacobian @ np.linalg.solve(of_contrasts, np.swapaxes(jacobian, 1, 2))
    return float(np.sqrt(np.trace(spread, axis1=1, axis2=2).max()))
