"""From a table of sightings to a calibration that says how far to trust it: the main path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.diagnostics import (
    Diagnostic,
    diagnose_anisotropy,
    diagnose_fit,
    diagnose_image_plane,
    diagnose_noise,
    diagnose_rival,
    diagnose_weakness,
)
from sonocal.errors import InputError, UnsupportedError
from sonocal.geometry import Array, AxisScaled, homogeneous_points, segment_directions
from sonocal.observations import Observations, group_codes
from sonocal.registration.ambiguity import better_of_mirrored, rival_of
from sonocal.registration.degeneracy import (
    SUSPICIOUS_INFORMATION,
    near_degeneracy,
    refuse_degenerate_lines,
    refuse_free_motion,
)
from sonocal.registration.fit import Fit, Model, Weighting
from sonocal.registration.noise import Noise, estimate_noise, residual_vectors, stretch_length
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.robust import MINIMAL_ROWS, fit_point_lines
from sonocal.registration.rows import PointLineRows
from sonocal.registration.uncertainty import point_covariance, radius_95, weakest_motion

if TYPE_CHECKING:
    from sonocal.report import FrameImage

__all__ = ["Calibration", "ErrorStatistics", "calibrate"]

MODELS: tuple[Model, ...] = ("similarity", "anisotropic")
WEIGHTINGS: tuple[Weighting, ...] = ("likelihood", "geometric")


@dataclass(frozen=True)
class ErrorStatistics:
    """Distances of mapped points to their lines, mm.

    Of the rows that were fitted, only those that agree count; of held-out rows, all.

    Attributes:
        observations: rows given.
        inliers: rows within the threshold.
        rms_mm, median_mm, p95_mm, max_mm: over the rows that count.
    """

    observations: int
    inliers: int
    rms_mm: float
    median_mm: float
    p95_mm: float
    max_mm: float

    @classmethod
    def of(cls, counted_mm: Array, observations: int, inliers: int) -> ErrorStatistics:
        """The statistics of some distances (M,) in mm."""
        median, p95 = _quantiles(counted_mm, (0.5, 0.95))
        return cls(
            observations=observations,
            inliers=inliers,
            rms_mm=float(np.sqrt(np.mean(counted_mm**2))),
            median_mm=median,
            p95_mm=p95,
            max_mm=float(counted_mm.max()),
        )


@dataclass(frozen=True, eq=False)
class Calibration:
    """The map from the image's pixels to the probe marker's frame, and how far to trust it.

    Attributes:
        probe_from_image: mm from px.
        model: "similarity" (one scale) or "anisotropic" (one along u, one along v).
        covariance: (k, k), of the tangent: rotation vector applied on the left (rad), translation (mm),
            log scale (one, or two when anisotropic). None where no row is left to estimate the noise.
        noise: the standard deviations behind it, mm.
        area_px: (2, 2) or (2, 3): the least and the greatest corner of the image area that predicted
            errors are quoted for.
        fit, test: errors of the fitted and of the held-out rows.
        residuals_mm, inlier: (N,), of the fitted rows in the order given.
        diagnostics: what to know before use, warnings first.
        latency_s: the tracker's lag behind the image, or None when not estimated.
        provenance: input, options and versions.
    """

    probe_from_image: AxisScaled
    model: Model
    covariance: Array | None
    noise: Noise
    area_px: Array
    fit: ErrorStatistics
    test: ErrorStatistics | None
    residuals_mm: Array
    inlier: NDArray[np.bool_]
    diagnostics: tuple[Diagnostic, ...]
    latency_s: float | None = None
    provenance: dict[str, Any] = field(default_factory=dict)

    @property
    def dimension(self) -> int:
        """2 for a 2D probe, 3 for a 3D probe."""
        return int(self.area_px.shape[1])

    @property
    def warnings(self) -> tuple[Diagnostic, ...]:
        """The findings to read before use."""
        return tuple(d for d in self.diagnostics if d.severity == "warning")

    def predict(self, points_px: ArrayLike) -> tuple[Array, Array]:
        """Where points of the image are, and how well that is known.

        Args:
            points_px: (N, 2) or (N, 3), px.

        Returns:
            The points (N, 3) in mm in the probe marker's frame and their covariance (N, 3, 3) in mm^2,
            from the calibration's uncertainty alone (add the noise of the point itself).

        Raises:
            UnsupportedError: the calibration has no covariance.
        """
        if self.covariance is None:
            raise UnsupportedError(
                "this calibration has no row to spare and so no covariance; calibrate with more sightings"
            )
        return self.probe_from_image @ points_px, point_covariance(
            self.probe_from_image, self.covariance, points_px
        )

    def predicted_errors(self) -> tuple[Array, Array, Array]:
        """Predicted error at the corners and the centre of the area.

        Returns:
            The places (M, 2) or (M, 3) in px, the root mean square error (M,) and the error that 95 % stay
            below (M,), mm.

        Raises:
            UnsupportedError: the calibration has no covariance.
        """
        places = area_places(self.area_px)
        covariances = self.predict(places)[1]
        return (
            places,
            np.sqrt(np.trace(covariances, axis1=1, axis2=2)),
            radius_95(covariances, self.noise.freedom),
        )

    # The figures: each draws on a matplotlib axis that the caller made. They need the extra sonocal[report].

    def plot_predicted_error(self, axis: Any, observations: Observations | None = None) -> None:
        """The error that 95 % stay below, over the image."""
        from sonocal.report import figures

        figures.plot_predicted_error(axis, self, observations)

    def plot_residuals_over_image(self, axis: Any, observations: Observations) -> None:
        """Residuals as arrows where the needle was seen."""
        from sonocal.report import figures

        figures.plot_residuals_over_image(axis, self, observations)

    def plot_residuals_by_frame(
        self, axis: Any, observations: Observations, held_out: Observations | None = None
    ) -> None:
        """Distances of mapped points to their lines, frame after frame."""
        from sonocal.report import figures

        figures.plot_residuals_by_frame(axis, self, observations, held_out)

    def plot_tilts(self, axis: Any, observations: Observations) -> None:
        """The needle's directions from the image's normal, on a polar axis."""
        from sonocal.report import figures

        figures.plot_tilts(axis, self, observations)

    def plot_frames(self, axis: Any) -> None:
        """The marker and the image where the matrix puts it, on a 3D axis."""
        from sonocal.report import views3d

        views3d.plot_frames(axis, self)

    def plot_needles(self, axis: Any, observations: Observations) -> None:
        """Needle poses through the image, on a 3D axis."""
        from sonocal.report import views3d

        views3d.plot_needles(axis, self, observations)

    def plot_weak_motion(self, axis: Any) -> None:
        """Where the loosest motion would carry the image, enlarged, on a 3D axis."""
        from sonocal.report import views3d

        views3d.plot_weak_motion(axis, self)

    def plot_frame(self, axis: Any, frame: FrameImage) -> None:
        """An image with its detections, and the tracked needle carried into it."""
        from sonocal.report import pictures

        pictures.plot_frame(axis, self, frame)

    def save(self, path: str | Path) -> None:
        """Write the calibration as JSON, whole or not at all.

        Raises:
            InputError: the file cannot be written.
        """
        from sonocal.calibration_file import save_calibration

        save_calibration(self, path)


def calibrate(
    observations: Observations,
    *,
    model: Model = "similarity",
    weighting: Weighting = "likelihood",
    threshold_mm: float | Literal["auto"] = 5.0,
    sigma_px: float | None = None,
    sigma_mm: float | None = None,
    fit_split: str | None = None,
    test_split: str | None = None,
    image_size_px: tuple[int, ...] | None = None,
    tolerance_mm: float = 2.0,
    max_samples: int = 10_000,
    seed: int = 0,
) -> Calibration:
    """Calibrate a probe from sightings of a needle or of wires.

    Args:
        observations: one point of the image against one line in the probe marker's frame a row.
        model: "similarity", or "anisotropic" for a 2D probe whose pixels are not square in mm.
        weighting: "likelihood" weighs every residual by the noise that it carries; "geometric" takes all
            distances alike, as the paper does (section 8).
        threshold_mm: rows further than this from their line are outliers (paper section 9); "auto": 3.3
            standard deviations of the noise, found while more than half of the rows are sound.
        sigma_px: noise of an image point along every axis, px, where known; it multiplies the table's own
            column. Default: estimated from the residuals.
        sigma_mm: noise of a segment's end point along every axis, mm; likewise.
        fit_split: fit the rows of this split only; default: all but those of `test_split`.
        test_split: report the error of this split's rows, which are not fitted.
        image_size_px: (width, height[, depth]); predicted errors are quoted at this image's corners.
            Default: the corners of the box that holds the points seen.
        tolerance_mm: the predicted error (95 %) at a corner above which the answer comes with a warning.
        max_samples: random minimal samples at the most.
        seed: of the random samples; the same seed gives the same answer.

    Returns:
        The calibration.

    Raises:
        InputError: an option or a split is wrong, or rows are too few.
        DegenerateGeometryError: the sightings leave a motion free.
        NoConsensusError: no calibration agrees with enough rows.
        UnsupportedError: the anisotropic model of a 3D probe.

    Source: paper sections 5 to 9.
    """
    _check_options(
        model=model,
        weighting=weighting,
        threshold_mm=threshold_mm,
        tolerance_mm=tolerance_mm,
        max_samples=max_samples,
        sigma_px=sigma_px,
        sigma_mm=sigma_mm,
    )
    rows, held_out = _split(observations, fit_split, test_split)
    _check_rows(rows, model)
    area = _area(rows, image_size_px)
    table = point_line_rows(rows)

    # A sighting geometry that leaves a motion free has no answer: refuse before fitting, and again once
    # the outliers, which can hide it, are known.
    refuse_degenerate_lines(table.points, table.segments_mm, table.dimension)
    fit = fit_point_lines(
        table,
        model=model,
        weighting=weighting,
        threshold_mm=threshold_mm,
        sigma_px=sigma_px,
        sigma_mm=sigma_mm,
        max_samples=max_samples,
        seed=seed,
    )
    fit, mirrored = better_of_mirrored(table, fit, sigma_px=sigma_px, sigma_mm=sigma_mm)
    if fit.least_information < SUSPICIOUS_INFORMATION:
        refuse_degenerate_lines(table.points[fit.inlier], table.segments_mm[fit.inlier], table.dimension)
    refuse_free_motion(fit.least_information)

    known = {
        "known_px": bool(sigma_px) or rows.sigma_px is not None,
        "known_mm": bool(sigma_mm) or rows.sigma_mm is not None,
    }
    groupings, stretch = _groupings(table, rows.split, fit)
    noise = estimate_noise(table, fit, groupings, **known)
    rival = None if mirrored is None else rival_of(fit, mirrored, noise.covariance, area_places(area))
    if rival is not None:
        noise = replace(noise, covariance=noise.covariance + rival.covariance)
    diagnostics = [
        *diagnose_fit(fit),
        *diagnose_rival(rival),
        *_diagnose_weakness(table, fit, noise, area, tolerance_mm),
        *_diagnose_image_plane(table, fit),
        *diagnose_noise(noise, stretch),
        *_diagnose_anisotropy(table, fit, groupings),
    ]
    diagnostics.sort(key=lambda finding: finding.severity != "warning")
    return Calibration(
        probe_from_image=fit.transform,
        model=model,
        covariance=noise.covariance if np.all(np.isfinite(noise.covariance)) else None,
        noise=noise,
        area_px=area,
        fit=ErrorStatistics.of(fit.residuals_mm[fit.inlier], len(rows), int(fit.inlier.sum())),
        test=None if held_out is None else _test(held_out, fit),
        residuals_mm=fit.residuals_mm,
        inlier=fit.inlier,
        diagnostics=tuple(diagnostics),
        provenance={
            "input": rows.source,
            "sha256": rows.sha256,
            "options": {
                "model": model,
                "weighting": weighting,
                "threshold_mm": threshold_mm,
                "sigma_px": sigma_px,
                "sigma_mm": sigma_mm,
                "fit_split": fit_split,
                "test_split": test_split,
                "image_size_px": list(image_size_px) if image_size_px else None,
                "tolerance_mm": tolerance_mm,
                "max_samples": max_samples,
                "seed": seed,
            },
        },
    )


def _quantiles(values: Array, shares: tuple[float, ...]) -> list[float]:
    """Quantiles by linear interpolation: NumPy's own take a tenth of a whole calibration's time."""
    ordered = np.sort(values)
    return [
        float(np.interp(share * (len(ordered) - 1), np.arange(len(ordered)), ordered)) for share in shares
    ]


def area_places(area_px: Array) -> Array:
    """Corners and centre (M, d) of an area given by its least and its greatest corner (2, d)."""
    dimension = area_px.shape[1]
    choice = np.indices((2,) * dimension).reshape(dimension, -1).T
    corners = area_px[choice, np.arange(dimension)]
    return np.vstack([corners, area_px.mean(axis=0)])


def _split(
    observations: Observations, fit_split: str | None, test_split: str | None
) -> tuple[Observations, Observations | None]:
    if test_split is not None and test_split == fit_split:
        raise InputError(f"fit_split and test_split are both {fit_split!r}; held-out rows must not be fitted")
    held_out = None if test_split is None else observations.select_split(test_split)
    if fit_split is not None:
        return observations.select_split(fit_split), held_out
    if held_out is not None:
        return observations.select(observations.split != test_split), held_out
    return observations, None


def point_line_rows(observations: Observations) -> PointLineRows:
    """The table as registration takes it."""
    sightings = observations.sightings.astype(np.int32) if observations.dimension == 3 else None
    return PointLineRows(
        points=np.ascontiguousarray(homogeneous_points(observations.points_px)),
        segments_mm=np.ascontiguousarray(observations.segments_mm),
        dimension=observations.dimension,
        sightings=sightings,
        frame=group_codes(observations.split, observations.frame).astype(np.int32),
        target=group_codes(observations.target).astype(np.int32),
        sigma_px=observations.sigma_px,
        sigma_mm=observations.sigma_mm,
    )


def _groupings(
    table: PointLineRows, split: NDArray[np.str_], fit: Fit
) -> tuple[dict[str, NDArray[Any]], int]:
    """What rows may share an error by: frame, needle or wire, stretch of frames; and a stretch's length."""
    assert table.frame is not None
    assert table.target is not None
    residuals = residual_vectors(fit.transform, table.points[fit.inlier], table.segments_mm[fit.inlier])
    stretch = stretch_length(residuals, group_codes(table.frame[fit.inlier]))
    groupings: dict[str, NDArray[Any]] = {"frame": table.frame, "target": table.target}
    if stretch > 1:
        groupings["stretch"] = group_codes(split, table.frame // stretch)
    return groupings, stretch


def _diagnose_weakness(
    table: PointLineRows, fit: Fit, noise: Noise, area: Array, tolerance_mm: float
) -> Iterator[Diagnostic]:
    if not np.all(np.isfinite(noise.covariance)):
        return
    corners = area_places(area)[:-1]
    covariances = point_covariance(fit.transform, noise.covariance, corners)
    worst = float(radius_95(covariances, noise.freedom).max())
    if worst <= tolerance_mm:
        return
    motion = weakest_motion(fit.transform, noise.covariance, corners)
    yield from diagnose_weakness(
        motion,
        worst,
        tolerance_mm,
        near_degeneracy(table.points[fit.inlier], table.segments_mm[fit.inlier], table.dimension),
    )


def _diagnose_image_plane(table: PointLineRows, fit: Fit) -> Iterator[Diagnostic]:
    if table.dimension == 2:
        directions = segment_directions(table.segments_mm[fit.inlier])
        yield from diagnose_image_plane(fit.transform.rotation, directions)


def _diagnose_anisotropy(
    table: PointLineRows, fit: Fit, groupings: dict[str, NDArray[Any]]
) -> Iterator[Diagnostic]:
    """Fits the wider model too, and tests whether its two scales differ."""
    if table.dimension == 3 or fit.model == "anisotropic" or fit.inlier.sum() <= MINIMAL_ROWS:
        return
    wider = refine_point_lines(
        fit.transform,
        table,
        fit.inlier,
        model="anisotropic",
        weighting=fit.weighting,
        sigma_px=fit.sigma_px,
        sigma_mm=fit.sigma_mm,
    )
    # Errors that rows share only widen the covariance: scales alike without them are alike with them.
    if any(diagnose_anisotropy(wider.transform.scales, _least_covariance(wider))):
        yield from diagnose_anisotropy(
            wider.transform.scales, estimate_noise(table, wider, groupings).covariance
        )


def _least_covariance(fit: Fit) -> Array:
    """The tangent's covariance if rows shared no error."""
    if fit.weighting == "likelihood":
        return fit.covariance
    freedom = 2 * int(fit.inlier.sum()) - len(fit.covariance)
    return fit.covariance * float(np.sum(fit.residuals_mm[fit.inlier] ** 2)) / freedom


def _test(held_out: Observations, fit: Fit) -> ErrorStatistics:
    vectors = residual_vectors(fit.transform, homogeneous_points(held_out.points_px), held_out.segments_mm)
    distances = np.linalg.norm(vectors, axis=1)
    return ErrorStatistics.of(distances, len(held_out), int(np.sum(distances <= fit.threshold_mm)))


def _area(rows: Observations, image_size_px: tuple[int, ...] | None) -> Array:
    if image_size_px is None:
        return np.array([rows.points_px.min(axis=0), rows.points_px.max(axis=0)])
    size = np.asarray(image_size_px, dtype=float)
    if size.shape != (rows.dimension,) or not np.all(size >= 1):
        raise InputError(
            f"image_size_px must be {rows.dimension} positive numbers for a {rows.dimension}D probe; "
            f"got {image_size_px}"
        )
    return np.array([np.zeros(rows.dimension), size - 1])


def _check_options(
    *,
    model: str,
    weighting: str,
    threshold_mm: float | str,
    tolerance_mm: float,
    max_samples: int,
    sigma_px: float | None,
    sigma_mm: float | None,
) -> None:
    for name, choice, choices in (("model", model, MODELS), ("weighting", weighting, WEIGHTINGS)):
        if choice not in choices:
            raise InputError(f"{name} must be one of {', '.join(choices)}; got {choice!r}")
    numbers: dict[str, Any] = {"tolerance_mm": tolerance_mm, "max_samples": max_samples}
    numbers |= {"threshold_mm": threshold_mm} if threshold_mm != "auto" else {}
    numbers |= {
        name: value for name, value in (("sigma_px", sigma_px), ("sigma_mm", sigma_mm)) if value is not None
    }
    for name, value in numbers.items():
        if not (isinstance(value, (int, float)) and np.isfinite(value) and value > 0):
            raise InputError(f"{name} must be a positive number; got {value}")


def _check_rows(rows: Observations, model: Model) -> None:
    if rows.dimension == 3 and model == "anisotropic":
        raise UnsupportedError(
            "the anisotropic model is for 2D probes; calibrate a 3D probe with the similarity model"
        )
    needed = MINIMAL_ROWS + (model == "anisotropic")
    if len(rows) < needed:
        raise InputError(
            f"{rows.source}: has {len(rows)} rows to fit and the {model} model of a {rows.dimension}D probe needs "
            f"at least {needed}; scan more needle poses, ten or more for an answer to rely on"
        )
    if rows.dimension == 3:
        _check_sightings(rows)


def _check_sightings(rows: Observations) -> None:
    """A 3D sighting is one needle: two points or more on its image line, one segment."""
    sightings = rows.sightings
    order = np.argsort(sightings, kind="stable")
    same = sightings[order[1:]] == sightings[order[:-1]]
    unlike = np.any(rows.segments_mm[order[1:]] != rows.segments_mm[order[:-1]], axis=(1, 2))
    if np.any(same & unlike):
        first, second = np.sort(order[np.argmax(same & unlike) + np.arange(2)])
        raise InputError(
            f"{rows.where(second)}: has another segment than {rows.where(first).removeprefix(rows.source + ', ')} "
            f"of the same frame {rows.frame[second]} and target {str(rows.target[second])!r}; points of one needle in "
            "one image share its segment, other needles need another target"
        )
    if np.sum(np.bincount(sightings) >= 2) < 2:
        raise InputError(
            f"{rows.source}: fewer than two sightings have two points; a 3D probe sees a needle as a line, so give "
            "two or more rows with one frame and target, or leave out w_px for a 2D probe"
        )
