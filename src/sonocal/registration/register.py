"""Any mix of points, lines and planes that determines a similarity, in one call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal import _core
from sonocal.errors import DegenerateGeometryError, InputError, MirroredVolumeError, NoConsensusError, require
from sonocal.geometry import Array, Similarity
from sonocal.registration.alternatives import alternatives_to
from sonocal.registration.certificate import Certificate, LazyCertificate, certificate_of
from sonocal.registration.constraints import Rows, refuse_degenerate_rows
from sonocal.registration.degeneracy import (
    SUSPICIOUS_INFORMATION,
    refuse_degenerate_lines,
    refuse_free_motion,
)
from sonocal.registration.distinct import distinct_of
from sonocal.registration.fit import Fit, transform_of
from sonocal.registration.mirrored import refuse_mirrored_target
from sonocal.registration.mixed import least_squares, maximise
from sonocal.registration.options import Options, Weighting, true_or_false, unknowns
from sonocal.registration.refusals import (
    PARAMETERS,
    refuse_chance,
    refuse_few,
    refuse_free,
    refuse_free_about,
)
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.rows import PointLineRows
from sonocal.registration.told import Told, scale_of, sigmas_of, weights_of

__all__ = ["PARAMETERS", "Registration", "register"]

# Of how far targets are missed: a source whose picture is smaller is a point there.
SHRUNK = 1e-9
# Of where it comes to: a source of that size is a point but for rounding.
ROUNDED = 1e-9


@dataclass(frozen=True, eq=False)
class Registration:
    """A similarity and the correspondences that agree with it.

    Attributes:
        target_from_source: mm from px (or whatever units the two sides have).
        covariance: (7, 7), of the tangent: rotation vector applied on the left (rad), translation (mm), log
            scale; the noise is in it. None where no row is left to estimate the noise.
        freedom: degrees of freedom that the noise in it is known with: errors are Student's t of so many, and a
            seventh of their squared size in units of the covariance is F(7, freedom). 0 where there is none.
        residuals_mm: (C,): root mean square distance of each correspondence's points from their targets.
        inlier: (C,): whether the correspondence was fitted.
        threshold_mm: correspondences within this distance agree.
        samples: how many minimal samples were tried.
        converged: whether the refinement came to rest.
        sigma_px, sigma_mm: noise levels behind the likelihood's weights, given or estimated: of a source point and of
            a point that spans a target, along every axis. None where all distances counted alike.
    """

    target_from_source: Similarity
    covariance: Array | None
    freedom: float
    residuals_mm: Array
    inlier: NDArray[np.bool_]
    threshold_mm: float
    samples: int
    converged: bool
    sigma_px: float | None = None
    sigma_mm: float | None = None
    _others: Callable[[], tuple[Similarity, ...]] = field(default=tuple, repr=False)
    _certificate: LazyCertificate = field(default_factory=LazyCertificate.known, repr=False)

    @cached_property
    def alternatives(self) -> tuple[Similarity, ...]:
        """Other similarities, far from this one, that the correspondences that agree do not exclude; best first.

        Looked for when first read: seven rows have up to eight answers, lines that are nearly parallel two.
        """
        return self._others()

    @property
    def certificate(self) -> Certificate:
        """Whether it is the best of all similarities for the correspondences that agree, weighed as they are.

        "optimal": every other one leaves more. "tied": none leaves less, but another may leave as much. "not shown":
        another may leave less. Looked for when first read, in some tens of microseconds.
        """
        return self._certificate.read()

    def __repr__(self) -> str:
        agreeing = int(np.count_nonzero(self.inlier))
        return (
            f"<Registration: {self.target_from_source!r}, {agreeing} of {len(self.inlier)} correspondences>"
        )


def register(
    constraints: Rows,
    *,
    robust: bool = True,
    refine: bool = True,
    weighting: Weighting = "likelihood",
    threshold_mm: float | Literal["auto"] = 5.0,
    sigma_px: float | None = None,
    sigma_mm: float | ArrayLike | None = None,
    scale: float | None = None,
    confidence: float = 0.9999,
    max_samples: int = 10_000,
    seed: int = 0,
) -> Registration:
    """The similarity that brings points, lines and planes onto points, lines and planes.

    Points of an image plane on lines, and lines on lines, take the closed forms and the likelihood of
    `fit_point_lines`. Every other mix takes samples of as many correspondences as determine a similarity,
    seven rows of which give candidates (`solvers.three_quadrics`), and on those that agree the same likelihood: of
    noise of the source's points and of the points that span the targets. Planes that are given as numbers, and not by
    points, say nothing of their noise: least squares takes all distances alike.

    Args:
        constraints: from `point_plane`, `point_line`, `point_point`, `line_line`, `line_plane`,
            `plane_plane`; several kinds put together by `rows`. One that repeats another number for number is no
            second measurement, and counts once.
        robust: leave out correspondences further than the threshold; False: fit all.
        refine: False: the answer of the consensus, before it is refined to convergence.
        weighting: "likelihood" weighs residuals by the noise they carry; "geometric", and a mix with planes that are
            not given by points, takes all distances alike.
        threshold_mm: correspondences within this distance agree, in units of the target; "auto" (points of
            an image, or lines of a volume, on lines only): from the noise.
        sigma_px: noise of a source point along every axis, where known; for the likelihood.
        sigma_mm: noise of a point that spans a target along every axis, where known; for the likelihood. (C,): of
            each correspondence's distance; what counts are their ratios.
        scale: mm per px, where it is known (rigid): the answer has it, its row and column of the covariance are zero.
        confidence: of having drawn a sample without outliers.
        max_samples: random samples at the most.
        seed: of the random samples.

    Returns:
        The registration.

    Raises:
        InputError: a value is not finite, an option means nothing, or "auto" is asked of a mix.
        DegenerateGeometryError: the correspondences leave a motion free; the sentence names it and the rank.
        NoConsensusError: no similarity agrees with enough of them.

    Source: paper sections 5.1 and 9; Ramalingam and Taguchi 2010.
    """
    require("constraints", constraints, Rows)
    sigmas_mm = sigmas_of(sigma_mm)
    known = None if scale is None else scale_of(scale)
    options = Options.known(
        "similarity" if known is None else "rigid",
        weighting,
        threshold_mm if true_or_false("robust", robust) else np.inf,
        sigma_px,
        sigma_mm if sigmas_mm is None else None,
        confidence,
        max_samples,
        Options.exhaustive_samples,
        seed,
        known,
    )
    refine = true_or_false("refine", refine)
    refuse_few(constraints)
    told = Told(None if sigmas_mm is None else weights_of(sigmas_mm, len(constraints.first) - 1))
    distinct = distinct_of(constraints, told.weights)
    if distinct is None:
        return _registered(constraints, options, told, refine=refine)
    weights = None if told.weights is None else told.weights[distinct.first]
    found = _registered(distinct.rows, options, replace(told, weights=weights), refine=refine)
    return replace(
        found, residuals_mm=found.residuals_mm[distinct.of_each], inlier=found.inlier[distinct.of_each]
    )


def _registered(constraints: Rows, options: Options, told: Told, *, refine: bool) -> Registration:
    """Correspondences that all differ, by the fastest way that they have."""
    try:
        found = (
            _register_lines(constraints, constraints.lines, options)
            if constraints.lines is not None and refine and told.weights is None
            else _register_mix(constraints, options, told, refine=refine)
        )
    except MirroredVolumeError:
        raise
    except NoConsensusError as error:
        refuse_mirrored_target(constraints, options, error.best_count or 0)
        raise
    refuse_mirrored_target(constraints, options, int(np.count_nonzero(found.inlier)))
    return found


def _register_mix(constraints: Rows, options: Options, told: Told, *, refine: bool) -> Registration:
    found, start = _consensus_of_mix(constraints, options, told, refine=refine)
    fit = None
    if refine and options.weighting == "likelihood" and constraints.spanned is not None:
        fit = maximise(constraints.spanned, start, options, told)
    if fit is None:
        fit = least_squares(constraints, start, found, options, told)
    if fit.covariance is None and np.diff(constraints.first)[fit.inlier].sum() > PARAMETERS:
        agreeing = constraints.select(fit.inlier)
        refuse_free_about(agreeing, fit.transform, scale_known=options.model == "rigid")
    covariance = fit.covariance.matrix if fit.covariance else None
    return Registration(
        target_from_source=fit.transform,
        covariance=covariance,
        freedom=fit.covariance.freedom if fit.covariance else 0.0,
        residuals_mm=fit.residuals_mm,
        inlier=fit.inlier,
        threshold_mm=found.threshold,
        samples=found.samples,
        converged=fit.converged,
        sigma_px=fit.sigma_px,
        sigma_mm=fit.sigma_mm,
        _others=partial(
            alternatives_to,
            fit.transform,
            covariance,
            constraints.select(fit.inlier),
            weights=told.of_rows(constraints, fit.inlier),
            scale=options.scale_mm_per_px,
            seed=options.seed,
        ),
        _certificate=LazyCertificate(fit.certificate),
    )


def _consensus_of_mix(
    constraints: Rows, options: Options, told: Told, *, refine: bool
) -> tuple[_core.Estimate, Similarity]:
    """What most correspondences agree with, refined on those by least squares."""
    if options.threshold_mm == "auto":
        raise InputError(
            'threshold_mm="auto" needs points of an image, or lines of a volume, on lines alone; give others a '
            "threshold in mm"
        )
    found = _core.estimate_correspondences(
        constraints.core, options.to_core(0, 0), refine=refine, weights=told.weights
    )
    if not found.found:
        refuse_free(constraints)
        raise NoConsensusError("no minimal sample of the correspondences has a similarity", best_count=0)
    size_mm = found.scales[0] * float(np.ptp(constraints.points, axis=0).max())
    if not (size_mm > SHRUNK * found.residuals_mm.min() and np.isfinite(found.translation).all()):
        raise NoConsensusError(
            "no similarity brings the correspondences together: the best one shrinks the source to a point; "
            "check that they are matched and in the units meant",
            best_count=found.inliers,
        )
    similarity = transform_of(found)
    assert isinstance(similarity, Similarity)
    _refuse_shrunk(constraints, similarity)
    inlier = found.residuals_mm <= found.threshold
    if np.diff(constraints.first)[inlier].sum() < PARAMETERS:
        raise NoConsensusError(
            f"no similarity brings more than {found.inliers} of {len(inlier)} correspondences within "
            f"{found.threshold:.3g} mm of their targets; check that they are matched and in the units meant",
            best_count=found.inliers,
        )
    refuse_chance(constraints.core, similarity, found.residuals_mm, found.threshold)
    return found, similarity


def _refuse_shrunk(constraints: Rows, similarity: Similarity) -> None:
    """Raise where the source comes to one point, but for rounding: all targets meet there."""
    mapped = similarity @ constraints.points
    if np.ptp(mapped, axis=0).max() > ROUNDED * np.abs(similarity.translation).max():
        return
    refuse_degenerate_rows(constraints.points, constraints.planes)
    x, y, z = mapped[0]
    raise DegenerateGeometryError(
        f"all {len(constraints.first) - 1} targets pass through one point, ({x:.3g}, {y:.3g}, {z:.3g}), so the scale "
        "is free; add some that do not",
        code="lines-through-one-point",
    )


def _register_lines(constraints: Rows, lines: PointLineRows, options: Options) -> Registration:
    try:
        fit = fit_point_lines(lines, options)
    except NoConsensusError:
        refuse_degenerate_lines(lines)
        raise
    agreeing = int(np.count_nonzero(fit.inlier))
    if agreeing and fit.least_information < SUSPICIOUS_INFORMATION:
        refuse_degenerate_lines(lines, fit.inlier)
        refuse_free_motion(fit.least_information)
    residuals, inlier = fit.residuals_mm, fit.inlier
    if lines.dimension == 3:  # both points of a line
        residuals = np.sqrt(0.5 * (residuals[::2] ** 2 + residuals[1::2] ** 2))
        inlier = inlier[::2] & inlier[1::2]
    spare = 2 * agreeing - unknowns(options.model, lines.dimension)
    assert isinstance(fit.transform, Similarity)
    similarity, covariance = fit.transform, _line_covariance(fit, spare)
    if not fit.plain:
        refuse_chance(lines.core, fit.transform, residuals, fit.threshold_mm)
    return Registration(
        target_from_source=similarity,
        covariance=covariance,
        freedom=_line_freedom(options, spare),
        residuals_mm=residuals,
        inlier=inlier,
        threshold_mm=fit.threshold_mm,
        samples=fit.samples,
        converged=fit.converged,
        sigma_px=fit.sigma_px if fit.weighting == "likelihood" else None,
        sigma_mm=fit.sigma_mm if fit.weighting == "likelihood" else None,
        _others=lambda: alternatives_to(
            similarity,
            covariance,
            constraints.select(inlier),
            scale=options.scale_mm_per_px,
            seed=options.seed,
        ),
        _certificate=LazyCertificate(partial(certificate_of, lines, fit)),
    )


def _line_covariance(fit: Fit, spare: int) -> Array | None:
    if spare <= 0:
        return None
    of_all = np.pad(fit.covariance, (0, PARAMETERS - len(fit.covariance)))  # zero for a scale that is known
    return of_all if fit.weighting == "likelihood" else of_all * (fit.squares_mm2 / spare)


def _line_freedom(options: Options, spare: int) -> float:
    """Noise that was given is known."""
    given = options.weighting == "likelihood" and options.sigma_px and options.sigma_mm
    return np.inf if given else float(max(spare, 0))
