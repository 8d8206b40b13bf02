"""A calibration: the map, how far to trust it, and its file."""

from __future__ import annotations

import datetime
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.calibration.found_phantom import FoundPhantom
from sonocal.calibration.found_targets import FoundTarget
from sonocal.calibration.in_session import InSession
from sonocal.calibration.options import Options
from sonocal.calibration.record import CONVENTIONS, FORMAT, VERSION, Kept, Record, Sigma
from sonocal.calibration.sound import Sound
from sonocal.calibration.statistics import ErrorStatistics
from sonocal.errors import FormatError, InputError, UnsupportedError, require
from sonocal.files import path_of, read_bytes, write_atomically
from sonocal.files.elsewhere import refuse_other_kind
from sonocal.findings import Diagnostic, Findings
from sonocal.geometry import FURTHEST, Array, AxisScaled, Similarity, area_places, frozen, real_array
from sonocal.registration.certificate import Certificate, LazyCertificate
from sonocal.registration.lazy import Lazy, found
from sonocal.registration.model_test import ModelTest
from sonocal.registration.noise import Noise
from sonocal.registration.options import Model, scale_count, unknowns
from sonocal.registration.uncertainty import point_covariance, radius_95

# As many residuals as the core can count.
MOST_FREEDOM = 2**31

__all__ = ["Calibration", "calibration_json", "load_calibration", "parse_calibration"]


# So far from the image that where it lies no longer matters, and only how it is turned and scaled does.
FAR_PX = 1e6


@dataclass(frozen=True, eq=False)
class Calibration(InSession):
    """The map from the image's pixels to the probe marker's frame, and how far to trust it.

    Attributes:
        probe_from_image: mm from px.
        model: "similarity" (one scale), "anisotropic" (one along u, one along v, in a volume one along w) or "rigid"
            (a known scale).
        covariance: (k, k), of the tangent: rotation vector applied on the left (rad), translation (mm),
            log scale (one; two or three when anisotropic; none when rigid). None where no row is left to estimate the
            noise.
        noise: the standard deviations behind it, mm.
        area_px: (2, 2) or (2, 3): the least and the greatest corner of the image area that predicted
            errors are quoted for.
        image_size_px: of the images, where it is known: then `area_px` is the image, else the area seen.
        seen_px: (2, d): the box of the fitted rows that agree; None where the file is of a sonocal that kept none.
        fit, test: errors of the fitted and of the held-out rows.
        residuals_mm, inlier: (N,), of the fitted rows in the order given.
        diagnostics: what to know before use, warnings first; of a fresh one, looked for when they are first read.
        latency_s: how much later the tracker stamps an instant than the images do, where that was undone; or None.
        latency_interval_s: the 95 % interval of that, where it was estimated with the calibration; or None.
        sound: its speed in what was scanned, where the options say more of it than that it is as the scanner assumes:
            `probe_from_image` is for images in which it is so.
        targets: by name, where targets are whose place was found with the calibration, each in its own frame.
        phantom: of known shape, whose place was found with the calibration; or None.
        options: those it was made with; of the threshold, the mm that "auto" came to.
        provenance: input, options as the file keeps them, and versions.
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
    diagnostics: Sequence[Diagnostic] = ()
    latency_s: float | None = None
    latency_interval_s: tuple[float, float] | None = None
    sound: Sound | None = None
    image_size_px: tuple[int, ...] | None = None
    seen_px: Array | None = None
    targets: Mapping[str, FoundTarget] = field(default_factory=dict)
    phantom: FoundPhantom | None = None
    options: Options = field(default_factory=Options)
    provenance: dict[str, Any] = field(default_factory=dict)
    _certificate: LazyCertificate = field(default_factory=LazyCertificate.known, repr=False)
    _models: Lazy[tuple[ModelTest, ...]] = field(default_factory=partial(Lazy, tuple), repr=False)

    def __post_init__(self) -> None:
        for array in (self.covariance, self.area_px, self.residuals_mm, self.inlier):
            if array is not None:
                frozen(array)

    def __repr__(self) -> str:
        scales = self.scales_mm_per_px
        expected = "no error is predicted"
        if self.covariance is not None:
            worst = self.predicted_errors()[2][:-1].max()
            expected = f"errors up to {worst:.2g} mm at the corners of the {self.area_name} (95 %)"
        return (
            f"<Calibration of a {self.dimension}D probe: {' x '.join(f'{s:.4g}' for s in scales)} mm/px, "
            f"{self.fit.inliers} of {self.fit.observations} rows, {expected}>"
        )

    @property
    def certificate(self) -> Certificate:
        """Whether the answer is the best of all for the rows that agree, weighed as they are.

        "optimal": every other one costs more. "tied": none costs less, but another may cost the same. "not shown":
        another may cost less. Looked for when first read, in some tens of microseconds.
        """
        return self._certificate.read()

    @property
    def models(self) -> tuple[ModelTest, ...]:
        """The model against others: whether a known scale agrees with the rows, whether the axes have one scale.

        Looked for when first read; empty where no rows are to spare, or the file is of a sonocal that kept none.
        """
        return self._models.read()

    @property
    def scales_mm_per_px(self) -> Array:
        """(1,), or along every axis of the image (d,), of the anisotropic model."""
        return self.probe_from_image.scales[: _scale_count(self.model, self.dimension)]

    @property
    def dimension(self) -> int:
        """2 for a 2D probe, 3 for a 3D probe."""
        return int(self.area_px.shape[1])

    @property
    def area_is_image(self) -> bool:
        """Whether `area_px` is the image; else it is the area seen, and nothing is said of the image beyond it."""
        return self.image_size_px is not None

    @property
    def area_name(self) -> str:
        """What `area_px` is, for messages."""
        return "image" if self.area_is_image else "area seen"

    @property
    def accepted(self) -> tuple[Array, float, str]:
        """The area (2, d), the error (95 %) that is accepted at its corners, mm, and what messages call the area."""
        return self.area_px, self.options.tolerance_mm, self.area_name

    @property
    def threshold_mm(self) -> float:
        """Rows within this distance of their lines agree."""
        threshold = self.options.threshold_mm
        if threshold == "auto":
            raise InputError(
                'a calibration knows the threshold that "auto" came to; give its options a number'
            )
        return threshold

    @property
    def warnings(self) -> tuple[Diagnostic, ...]:
        """The findings to read before use."""
        return tuple(d for d in self.diagnostics if d.severity == "warning")

    def with_findings(self, findings: Iterable[Diagnostic]) -> Calibration:
        """The calibration with further findings, warnings first."""
        known = self.diagnostics if isinstance(self.diagnostics, Findings) else Findings(self.diagnostics)
        return replace(self, diagnostics=known.with_further(findings))

    def predict(self, points_px: ArrayLike) -> tuple[Array, Array]:
        """Where points of the image are, and how well that is known.

        Args:
            points_px: (N, 2) or (N, 3), px.

        Returns:
            The points (N, 3) in mm in the probe marker's frame and their covariance (N, 3, 3) in mm^2,
            from the calibration's uncertainty alone (add the noise of the point itself).

        Raises:
            InputError: the points are no such array of numbers.
            UnsupportedError: the calibration has no covariance.
        """
        points_px = real_array("points_px", points_px)
        if points_px.ndim != 2 or points_px.shape[1] not in {3, self.dimension}:
            wanted = "(N, 2)" if self.dimension == 2 else "(N, 3)"
            raise InputError(
                f"points_px must have shape {wanted}, a row a point of the {self.dimension}D image; got shape "
                f"{points_px.shape}"
            )
        if len(rows := np.flatnonzero(~np.all(np.abs(points_px) < FURTHEST, axis=1))):
            place = ", ".join(f"{x:.3g}" for x in points_px[rows[0]])
            raise InputError(
                f"points_px must lie in an image; row {rows[0]} is at ({place}) px, leave it out"
            )
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

    def error_growth_mm_per_px(self) -> float:
        """The most that the predicted error (95 %) grows by a px outside of the area, whichever way one goes.

        Errors far from the area grow in proportion to the way, and nowhere faster: the error is a convex function.

        Raises:
            UnsupportedError: the calibration has no covariance.
        """
        low, high = self.area_px
        corners = area_places(np.array([-np.ones(self.dimension), np.ones(self.dimension)]))[:-1]
        ways = np.vstack([np.eye(self.dimension), corners / np.sqrt(self.dimension)])
        covariances = self.predict((low + high) / 2 + FAR_PX * ways)[1]
        return float(radius_95(covariances, self.noise.freedom).max()) / FAR_PX

    def save(self, path: str | Path) -> None:
        """Write the calibration as JSON, whole or not at all; a file of that name is replaced.

        Raises:
            InputError: the file cannot be written.
        """
        write_atomically(path, calibration_json(self))


def calibration_json(calibration: Calibration) -> bytes:
    """The calibration as the text of its file."""
    require("calibration", calibration, Calibration)
    transform = calibration.probe_from_image
    record = Record(
        format=FORMAT,
        version=VERSION,
        conventions=CONVENTIONS,
        created=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        probe_from_image=transform.matrix.tolist(),
        model=calibration.model,
        scale_mm_per_px=calibration.scales_mm_per_px.tolist(),
        rotation_wxyz=transform.quaternion_wxyz.tolist(),
        translation_mm=transform.translation.tolist(),
        covariance=None if calibration.covariance is None else calibration.covariance.tolist(),
        sigma=Sigma(
            row_mm=calibration.noise.row_mm if np.isfinite(calibration.noise.row_mm) else None,
            point_px=calibration.noise.sigma_px,
            segment_mm=calibration.noise.sigma_mm,
            shared_mm=calibration.noise.shared_mm,
            freedom=calibration.noise.freedom,
            drift=calibration.noise.drift,
            apparent=calibration.noise.apparent,
        ),
        area_px=calibration.area_px.tolist(),
        image_size_px=None if calibration.image_size_px is None else list(calibration.image_size_px),
        seen_px=None if calibration.seen_px is None else calibration.seen_px.tolist(),
        fit=calibration.fit,
        test=calibration.test,
        residuals_mm=calibration.residuals_mm.tolist(),
        inlier=calibration.inlier.tolist(),
        latency_s=calibration.latency_s,
        latency_interval_s=calibration.latency_interval_s,
        sound=calibration.sound,
        targets=dict(calibration.targets),
        phantom=calibration.phantom,
        certificate=calibration.certificate,
        models=list(calibration.models),
        diagnostics=list(calibration.diagnostics),
        provenance=calibration.provenance
        | {"options": _options_record(calibration), "versions": _versions()},
    )
    return msgspec.json.format(msgspec.json.encode(record), indent=1) + b"\n"


def load_calibration(path: str | Path) -> Calibration:
    """Read a calibration that `Calibration.save` wrote.

    Raises:
        InputError: the file cannot be read.
        FormatError: it is not a calibration, or one of its fields is not what it must be.
        UnsupportedError: a later sonocal wrote it in a form that this one does not know.
    """
    path = path_of(path)
    refuse_other_kind(path, "calibration")
    return parse_calibration(read_bytes(path), path.name)


def parse_calibration(content: bytes, name: str) -> Calibration:
    """The calibration in the content of its file; `name` is what messages call it. Raises as `load_calibration`."""
    try:
        head = msgspec.json.decode(content, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FormatError(f"{name}: is not a calibration file ({error}); name the calibration.json") from None
    if head.get("format") != FORMAT:
        raise FormatError(
            f"{name}: is JSON but not a calibration: its format is {head.get('format')!r} where it must be {FORMAT!r}; "
            "name the calibration.json that sonocal calibrate wrote"
        )
    if isinstance(head.get("version"), int) and head["version"] > VERSION:
        raise UnsupportedError(
            f"{name}: has version {head['version']} of the calibration format and this sonocal reads up to "
            f"{VERSION}; update sonocal"
        )
    try:
        return _from_record(msgspec.convert(head, Record))
    except (msgspec.ValidationError, ValueError, InputError) as error:
        raise FormatError(f"{name}: is a damaged calibration file ({error}); calibrate again") from None


def _from_record(record: Record) -> Calibration:
    matrix = np.array(record.probe_from_image)
    if matrix.shape != (4, 4):
        raise ValueError(f"probe_from_image has shape {matrix.shape} and not (4, 4)")
    if not np.all(np.abs(matrix) < FURTHEST):
        raise ValueError(f"probe_from_image holds a number that is not below {FURTHEST:g}")
    dimension = np.shape(record.area_px)[-1] if np.size(record.area_px) else 0
    if len(record.scale_mm_per_px) != _scale_count(record.model, dimension):
        raise ValueError(
            f"scale_mm_per_px has {len(record.scale_mm_per_px)} entries for the {record.model} model"
        )
    if not all(0 < scale < FURTHEST for scale in record.scale_mm_per_px):
        raise ValueError(f"scale_mm_per_px is {record.scale_mm_per_px} and not positive")
    covariance = None if record.covariance is None else np.array(record.covariance)
    parameters = unknowns(record.model, dimension)
    if covariance is not None and covariance.shape != (parameters, parameters):
        raise ValueError(f"covariance has shape {covariance.shape} and not ({parameters}, {parameters})")
    if covariance is not None and not _is_covariance(covariance):
        raise ValueError("covariance is none: it is not finite, not symmetric, or of less than nothing")
    if not 0 <= record.sigma.freedom <= MOST_FREEDOM:
        raise ValueError(f"sigma.freedom is {record.sigma.freedom} and not from 0 to {MOST_FREEDOM}")
    for name, errors in (("fit", record.fit), ("test", record.test)):
        _check_errors(name, errors)
    residuals, inlier = np.array(record.residuals_mm), np.array(record.inlier, dtype=bool)
    if residuals.shape != inlier.shape:
        raise ValueError(f"residuals_mm has {len(residuals)} entries and inlier {len(inlier)}")
    options = _options(msgspec.convert(record.provenance, Kept).get("options", {}), residuals, inlier)
    size = options.image_size_px if record.image_size_px is None else tuple(record.image_size_px)
    area = _corners("area_px", record.area_px, (2, 3) if size is None else (len(size),))
    return Calibration(
        probe_from_image=_transform(matrix, record),
        model=record.model,
        covariance=covariance,
        noise=Noise(
            row_mm=np.nan if record.sigma.row_mm is None else record.sigma.row_mm,
            covariance=np.full((parameters, parameters), np.nan) if covariance is None else covariance,
            freedom=record.sigma.freedom,
            sigma_px=record.sigma.point_px,
            sigma_mm=record.sigma.segment_mm,
            apparent=record.sigma.apparent,
            shared_mm=record.sigma.shared_mm,
            drift=record.sigma.drift,
        ),
        area_px=area,
        image_size_px=size,
        seen_px=None if record.seen_px is None else _corners("seen_px", record.seen_px, area.shape[1:]),
        fit=record.fit,
        test=record.test,
        residuals_mm=residuals,
        inlier=inlier,
        diagnostics=tuple(record.diagnostics),
        latency_s=record.latency_s,
        latency_interval_s=record.latency_interval_s,
        sound=record.sound,
        targets=_targets(record.targets),
        phantom=_phantom(record.phantom),
        options=options,
        provenance=record.provenance,
        _certificate=LazyCertificate.known(record.certificate),
        _models=found(tuple(record.models)),
    )


def _check_errors(name: str, errors: ErrorStatistics | None) -> None:
    """Refuse counts that no rows have, and sizes that no errors have."""
    if errors is None:
        return
    if not 0 <= errors.inliers <= errors.observations:
        raise ValueError(f"{name} has {errors.inliers} inliers of {errors.observations} observations")
    sizes = (errors.rms_mm, errors.median_mm, errors.p95_mm, errors.max_mm)
    if not all(0 <= size < FURTHEST for size in sizes):
        raise ValueError(f"{name} has an error that is not from 0 to {FURTHEST:g} mm")


def _phantom(phantom: FoundPhantom | None) -> FoundPhantom | None:
    if phantom is None:
        return None
    if (
        np.shape(phantom.place) != (4, 4)
        or np.shape(phantom.covariance) != (6, 6)
        or len(phantom.middle_mm) != 3
    ):
        raise ValueError("phantom has numbers that are not those of a pose and its covariance")
    if not _is_covariance(np.array(phantom.covariance)):
        raise ValueError("phantom has a covariance that is none")
    return phantom


def _targets(targets: dict[str, FoundTarget]) -> dict[str, FoundTarget]:
    for name, target in targets.items():
        count = len(target.spanning_mm)
        free = (4 - count) * count if count in (1, 2, 3) else 0
        shapes = [np.shape(one) for one in (target.spanning_mm, target.axes, target.covariance)]
        if (
            shapes != [(count, 3), (3, 3), (free, free)]
            or target.kind != ("point", "line", "plane")[count - 1]
        ):
            raise ValueError(
                f"targets.{name} has numbers of shapes {shapes}, which are not those of a {target.kind}"
            )
        if not _is_covariance(np.array(target.covariance)):
            raise ValueError(f"targets.{name} has a covariance that is none")
    return targets


def _corners(name: str, given: list[list[float]], dimensions: tuple[int, ...]) -> Array:
    """(2, d): the least and the greatest corner of an area of one of the dimensions."""
    corners = np.array(given)
    if (
        corners.shape not in [(2, d) for d in dimensions]
        or not np.all(np.abs(corners) < FURTHEST)
        or np.any(corners[1] < corners[0])
    ):
        raise ValueError(f"{name} is {given} and not the least and the greatest corner of the area, px")
    return corners


def _is_covariance(matrix: Array) -> bool:
    if not np.all(np.abs(matrix) < FURTHEST**2) or not np.allclose(matrix, matrix.T, rtol=1e-6, atol=0):
        return False
    size = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    with np.errstate(over="ignore"):  # of a variance that is next to nothing
        correlation = matrix / np.outer(size, size)
    return bool(np.isfinite(correlation).all() and np.linalg.eigvalsh(correlation)[0] > -1e-6)


def _options(given: dict[str, Any], residuals_mm: Array, inlier: NDArray[np.bool_]) -> Options:
    """The options that a file gives; where it says "auto", with a threshold that parts the same rows."""
    options = Options.from_record(given)
    if options.threshold_mm != "auto":
        return options
    agreeing = float(residuals_mm[inlier].max(initial=np.finfo(float).tiny))
    further = float(residuals_mm[~inlier].min(initial=2.0 * agreeing))
    return options.resolved(0.5 * (agreeing + further))


def _options_record(calibration: Calibration) -> dict[str, Any]:
    """The options as they are kept, beside those that a recording had."""
    return {**calibration.provenance.get("options", {}), **calibration.options.record()}


def _transform(matrix: np.ndarray[Any, np.dtype[np.float64]], record: Record) -> AxisScaled:
    scales = np.resize(record.scale_mm_per_px, 3)
    if len(record.scale_mm_per_px) < 3:
        scales[2] = np.mean(record.scale_mm_per_px)
    rotation, translation = _exact_quotient(matrix[:3, :3], scales), matrix[:3, 3]
    similarity = Similarity(rotation, translation, scales[0])  # checks that it is one
    return AxisScaled(rotation, translation, scales) if record.model == "anisotropic" else similarity


def _exact_quotient(product: Array, factor: Array) -> Array:
    """What times the factor gives the product to the last bit, which the rounded quotient may miss by one."""
    quotient = product / factor
    for towards in (-np.inf, np.inf):
        neighbour = np.nextafter(quotient, towards)
        quotient = np.where(
            (quotient * factor != product) & (neighbour * factor == product), neighbour, quotient
        )
    return np.asarray(quotient)


def _scale_count(model: Model, dimension: int) -> int:
    """Of the model's transform, known ones among them."""
    return max(scale_count(model, dimension), 1)


@cache
def _versions() -> dict[str, str]:
    from importlib.metadata import version

    return {"sonocal": version("sonocal"), "numpy": np.__version__, "python": platform.python_version()}
