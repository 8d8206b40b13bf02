"""From a table of points, lines and planes to a calibration: the estimate of any mix, `registration.register`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.area import area_findings
from sonocal.calibration.diagnostics import diagnose_fit, diagnose_weakness
from sonocal.calibration.few_targets import ENOUGH_TARGETS
from sonocal.calibration.models import model_findings
from sonocal.calibration.options import Options, kept_options
from sonocal.calibration.result import Calibration
from sonocal.calibration.rows import image_area
from sonocal.calibration.statistics import ErrorStatistics
from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError, UnsupportedError
from sonocal.findings import Diagnostic, Findings
from sonocal.geometry import Array, Similarity, area_places, homogeneous_points
from sonocal.geometry.units import length_hints, scale_hints, scan_hints, unit_doubt
from sonocal.observations import Observations
from sonocal.registration.certificate import LazyCertificate
from sonocal.registration.constraints import rows_of_spanned
from sonocal.registration.lazy import Lazy
from sonocal.registration.model_test import SURE, ModelTest, tested
from sonocal.registration.noise import Noise
from sonocal.registration.options import Model, unknowns
from sonocal.registration.register import Registration, register
from sonocal.registration.spanned import SpannedRows
from sonocal.registration.uncertainty import point_covariance, radius_95, weakest_motion

__all__ = ["calibrate_mixed"]


def calibrate_mixed(rows: Observations, held_out: Observations | None, asked: Options) -> Calibration:
    """Calibrate from sightings of points, lines and planes.

    Args:
        rows: those to fit.
        held_out: those to measure, or None.
        asked: the options of `calibrate`.

    Raises:
        InputError: rows of one sighting differ in their target, or there are too few.
        DegenerateGeometryError: the sightings leave a motion free.
        NoConsensusError: no calibration agrees with enough sightings.
        UnsupportedError: the anisotropic model, or a threshold from the noise.
    """
    if not len(rows):
        raise InputError(f"{rows.source}: has no row to fit; see ten sightings or more, of several targets")
    if asked.model == "anisotropic":
        raise UnsupportedError(
            f"{rows.source}: holds points or planes, which are fitted by one scale; leave out the model"
        )
    if asked.threshold_mm == "auto":
        raise UnsupportedError(
            f"{rows.source}: holds points or planes, and these need a threshold in mm; give one"
        )
    sightings, of_row = _sightings(rows)
    found = _registered(sightings, asked, asked.scale_mm_per_px)
    similarity, inlier = found.target_from_source, found.inlier[of_row]
    residuals = target_distances(similarity, rows)
    targets = len(np.unique(rows.target[inlier]))
    predicts = found.covariance is not None and targets >= ENOUGH_TARGETS
    size, seen, area = image_area(rows, inlier, asked.image_size_px)
    calibration = Calibration(
        probe_from_image=similarity,
        model=asked.model,
        covariance=_of_unknowns(found, asked.model) if predicts else None,
        noise=_noise(found, asked.model, residuals[inlier]),
        area_px=area,
        image_size_px=size,
        seen_px=seen,
        fit=ErrorStatistics.of(residuals[inlier], len(rows), int(inlier.sum())),
        test=None if held_out is None else _errors(similarity, held_out, asked.threshold_mm),
        residuals_mm=residuals,
        inlier=inlier,
        options=asked,
        _certificate=LazyCertificate(lambda: found.certificate),
        _models=Lazy(partial(_scale_tested, sightings, asked, found, area_places(area)[:-1])),
        provenance={"input": rows.source, "sha256": rows.sha256, "options": kept_options(asked, asked)},
    )
    looks = (
        partial(diagnose_fit, found.inlier, found.threshold_mm, converged=found.converged, what="targets"),
        partial(_few_targets, 0 if predicts else targets),
        partial(_weakness, calibration),
        partial(model_findings, calibration),
        partial(_units, calibration, rows, inlier),
        partial(area_findings, calibration, rows.points_px[inlier]),
        _checks_of_lines,
    )
    return replace(calibration, diagnostics=Findings(looks=looks))


def _registered(sightings: SpannedRows, asked: Options, scale: float | None) -> Registration:
    assert asked.threshold_mm != "auto"
    return register(
        rows_of_spanned(sightings),
        weighting=asked.weighting,
        threshold_mm=asked.threshold_mm,
        sigma_px=asked.sigma_px,
        sigma_mm=asked.sigma_mm,
        scale=scale,
        confidence=asked.confidence,
        max_samples=asked.max_samples,
        seed=asked.seed,
    )


def _scale_tested(
    sightings: SpannedRows, asked: Options, found: Registration, places: Array
) -> tuple[ModelTest, ...]:
    """A known scale against a free one; nothing of a free one, or where the rows hold none."""
    if asked.scale_mm_per_px is None:
        return ()
    try:
        free = _registered(sightings, asked, None)
    except (DegenerateGeometryError, NoConsensusError):
        return ()
    if free.covariance is None or not free.freedom > 0:
        return ()
    known, own = found.target_from_source, free.target_from_source
    return tuple(tested(("rigid", known), ("similarity", own), free.covariance, (free.freedom, SURE), places))


def _of_unknowns(found: Registration, model: Model) -> Array:
    """(k, k): of a known scale `register` has a row and a column of zeros."""
    assert found.covariance is not None
    return found.covariance[:6, :6] if model == "rigid" else found.covariance


def target_distances(similarity: Similarity, rows: Observations) -> Array:
    """(N,), mm: of each mapped point from its point, line or plane."""
    assert rows.spanning_mm is not None
    away = similarity @ homogeneous_points(rows.points_px) - rows.spanning_mm[:, 0]
    sides = np.nan_to_num(rows.spanning_mm[:, 1:] - rows.spanning_mm[:, :1])
    along = np.einsum("nij,nj->ni", np.linalg.pinv(sides.transpose(0, 2, 1)), away)
    return np.asarray(np.linalg.norm(away - np.einsum("ni,nij->nj", along, sides), axis=1))


def _errors(similarity: Similarity, rows: Observations, threshold_mm: float) -> ErrorStatistics:
    distances = target_distances(similarity, rows)
    return ErrorStatistics.of(distances, len(rows), int(np.sum(distances <= threshold_mm)))


def _sightings(rows: Observations) -> tuple[SpannedRows, NDArray[np.int64]]:
    """The rows as sightings, points of one sighting together; and which sighting each row is of (N,).

    Raises:
        InputError: rows of one sighting have another target.
    """
    assert rows.spanning_mm is not None
    of_row = rows.sightings
    order = np.argsort(of_row, kind="stable")
    spanning = np.nan_to_num(rows.spanning_mm[order])
    again = of_row[order][1:] == of_row[order][:-1]
    if (wrong := again & np.any(spanning[1:] != spanning[:-1], axis=(1, 2))).any():
        first, second = order[np.argmax(wrong) + np.arange(2)]
        raise InputError(
            f"{rows.where(int(second))}: has another target than {rows.where(int(first))} of the same frame and "
            "target; points of one sighting share what they lie on, other targets need another name"
        )
    starts = np.concatenate([[0], np.flatnonzero(~again) + 1])
    counts = np.diff([*starts, len(rows)])
    sightings = SpannedRows(
        np.ascontiguousarray(homogeneous_points(rows.points_px)[order]),
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
        np.ascontiguousarray(spanning[starts]),
        np.ascontiguousarray(rows.spans[order][starts]),
        None if rows.sigma_mm is None else np.ascontiguousarray(rows.sigma_mm[order][starts]),
        None if rows.sigma_px is None else np.ascontiguousarray(rows.sigma_px[order]),
    )
    return sightings, of_row


def _noise(found: Registration, model: Model, residuals_mm: Array) -> Noise:
    row_mm = float(np.sqrt(np.mean(residuals_mm**2))) if found.covariance is not None else np.nan
    k = unknowns(model, 3)  # of one scale or none, whatever the image
    covariance = np.full((k, k), np.nan) if found.covariance is None else _of_unknowns(found, model)
    return Noise(row_mm, covariance, int(min(found.freedom, 2**31)))


def _few_targets(count: int) -> Iterator[Diagnostic]:
    if count:
        yield Diagnostic(
            code="few-targets",
            severity="warning",
            message=(
                f"all rows are of {count} target{'s' if count > 1 else ''}: where these are not what the table says, "
                "the calibration takes it up and no residual shows it; no error can be predicted"
            ),
            advice=f"see {ENOUGH_TARGETS} or more, each under a name of its own in the column target",
        )


def _units(calibration: Calibration, rows: Observations, inlier: NDArray[np.bool_]) -> Iterator[Diagnostic]:
    """Whether the scale exists, what is spanned has a size that things have, and the probe's marker a place."""
    similarity, covariance = calibration.probe_from_image, calibration.covariance
    scale = float(similarity.scales[0])
    deviation = 0.0 if covariance is None or len(covariance) < 7 else float(np.sqrt(covariance[6, 6]))
    hints = scale_hints(similarity.scales[:1], deviation, rows.dimension)
    spanned = inlier & (rows.spans >= 2)
    if spanned.any():
        hints += length_hints(rows.points_px[spanned], rows.segments_mm[spanned])
        if not hints:
            hints = scan_hints(
                image_mm=float(np.ptp(rows.points_px[inlier], axis=0).max() * scale),
                needle_mm=float(
                    np.median(np.linalg.norm(np.diff(rows.segments_mm[spanned], axis=1), axis=-1))
                ),
                marker_mm=float(
                    np.linalg.norm(similarity @ homogeneous_points(rows.points_px[inlier]).mean(0))
                ),
                scale=scale,
                rms_mm=calibration.fit.rms_mm,
                dimension=rows.dimension,
            )
    yield from unit_doubt(hints)


def _weakness(calibration: Calibration) -> Iterator[Diagnostic]:
    if calibration.covariance is None:
        return
    area = area_places(calibration.area_px)[:-1]
    about = calibration.probe_from_image, calibration.covariance, area
    freedom = calibration.noise.freedom
    worst = float(radius_95(point_covariance(*about), freedom).max())
    yield from diagnose_weakness(weakest_motion(*about), freedom, worst, calibration.accepted, None)


def _checks_of_lines() -> Iterator[Diagnostic]:
    yield Diagnostic(
        code="unchecked-set-up",
        severity="warning",
        message=(
            "the table holds points or planes: a time lag, a slipped marker, a wrong frame, unequal or distorted "
            "pixels, and errors that rows of a target or neighbouring frames share, are looked for in tables of lines "
            "alone"
        ),
        advice="hold some rows out (--test-split), or calibrate a sweep of a needle too and compare the two",
    )
