"""The calibration file: JSON that is read back to the last bit."""

from __future__ import annotations

import datetime
import platform
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from sonocal.calibration import Calibration, ErrorStatistics
from sonocal.errors import FormatError, InputError, UnsupportedError
from sonocal.files import read_bytes, write_atomically
from sonocal.findings import Diagnostic
from sonocal.geometry import AxisScaled, Similarity
from sonocal.registration.fit import Model
from sonocal.registration.noise import Noise

__all__ = [
    "FORMAT",
    "VERSION",
    "calibration_json",
    "load_calibration",
    "parse_calibration",
    "save_calibration",
]

FORMAT: Literal["sonocal-calibration"] = "sonocal-calibration"
VERSION = 1


class _Sigma(msgspec.Struct):
    row_mm: float | None
    point_px: float | None
    segment_mm: float | None
    shared_mm: dict[str, float]
    freedom: int


class _Record(msgspec.Struct):
    """The file's fields, in the order they are written."""

    format: Literal["sonocal-calibration"]
    version: int
    created: str
    probe_from_image: list[list[float]]
    model: Model
    scale_mm_per_px: list[float]
    rotation_wxyz: list[float]
    translation_mm: list[float]
    covariance: list[list[float]] | None
    sigma: _Sigma
    area_px: list[list[float]]
    fit: ErrorStatistics
    test: ErrorStatistics | None
    residuals_mm: list[float]
    inlier: list[bool]
    latency_s: float | None
    diagnostics: list[Diagnostic]
    provenance: dict[str, Any]


def calibration_json(calibration: Calibration) -> bytes:
    """The calibration as the text of its file."""
    transform = calibration.probe_from_image
    record = _Record(
        format=FORMAT,
        version=VERSION,
        created=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        probe_from_image=transform.matrix.tolist(),
        model=calibration.model,
        scale_mm_per_px=transform.scales[: _scale_count(calibration.model)].tolist(),
        rotation_wxyz=transform.quaternion_wxyz.tolist(),
        translation_mm=transform.translation.tolist(),
        covariance=None if calibration.covariance is None else calibration.covariance.tolist(),
        sigma=_Sigma(
            row_mm=calibration.noise.row_mm if np.isfinite(calibration.noise.row_mm) else None,
            point_px=calibration.noise.sigma_px,
            segment_mm=calibration.noise.sigma_mm,
            shared_mm=calibration.noise.shared_mm,
            freedom=calibration.noise.freedom,
        ),
        area_px=calibration.area_px.tolist(),
        fit=calibration.fit,
        test=calibration.test,
        residuals_mm=calibration.residuals_mm.tolist(),
        inlier=calibration.inlier.tolist(),
        latency_s=calibration.latency_s,
        diagnostics=list(calibration.diagnostics),
        provenance=calibration.provenance | {"versions": _versions()},
    )
    return msgspec.json.format(msgspec.json.encode(record), indent=1) + b"\n"


def save_calibration(calibration: Calibration, path: str | Path) -> None:
    """Write the calibration's file, whole or not at all.

    Raises:
        InputError: it cannot be written.
    """
    write_atomically(path, calibration_json(calibration))


def load_calibration(path: str | Path) -> Calibration:
    """Read a calibration that `Calibration.save` wrote.

    Raises:
        InputError: the file cannot be read.
        FormatError: it is not a calibration, or one of its fields is not what it must be.
        UnsupportedError: a later sonocal wrote it in a form that this one does not know.
    """
    path = Path(path)
    return parse_calibration(read_bytes(path), path.name)


def parse_calibration(content: bytes, name: str) -> Calibration:
    """The calibration in the content of its file; `name` is what messages call it. Raises as `load_calibration`."""
    try:
        head = msgspec.json.decode(content, type=dict[str, Any])
    except msgspec.DecodeError as error:
        raise FormatError(f"{name}: is not a calibration file ({error}); name the calibration.json") from None
    if head.get("format") != FORMAT:
        raise FormatError(f"{name}: is JSON but not a calibration; its format is {head.get('format')!r}")
    if isinstance(head.get("version"), int) and head["version"] > VERSION:
        raise UnsupportedError(
            f"{name}: has version {head['version']} of the calibration format and this sonocal reads up to "
            f"{VERSION}; update sonocal"
        )
    try:
        return _from_record(msgspec.convert(head, _Record))
    except (msgspec.ValidationError, ValueError, InputError) as error:
        raise FormatError(f"{name}: is a damaged calibration file ({error}); calibrate again") from None


def _from_record(record: _Record) -> Calibration:
    matrix = np.array(record.probe_from_image)
    if matrix.shape != (4, 4):
        raise ValueError(f"probe_from_image has shape {matrix.shape} and not (4, 4)")
    if len(record.scale_mm_per_px) != _scale_count(record.model):
        raise ValueError(
            f"scale_mm_per_px has {len(record.scale_mm_per_px)} entries for the {record.model} model"
        )
    covariance = None if record.covariance is None else np.array(record.covariance)
    parameters = 6 + _scale_count(record.model)
    if covariance is not None and covariance.shape != (parameters, parameters):
        raise ValueError(f"covariance has shape {covariance.shape} and not ({parameters}, {parameters})")
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
            shared_mm=record.sigma.shared_mm,
        ),
        area_px=np.array(record.area_px),
        fit=record.fit,
        test=record.test,
        residuals_mm=np.array(record.residuals_mm),
        inlier=np.array(record.inlier, dtype=bool),
        diagnostics=tuple(record.diagnostics),
        latency_s=record.latency_s,
        provenance=record.provenance,
    )


def _transform(matrix: np.ndarray[Any, np.dtype[np.float64]], record: _Record) -> AxisScaled:
    scales = np.resize(record.scale_mm_per_px, 3)
    scales[2] = np.mean(record.scale_mm_per_px)
    rotation, translation = matrix[:3, :3] / scales, matrix[:3, 3]
    similarity = Similarity(rotation, translation, scales[0])  # checks that it is one
    return similarity if record.model == "similarity" else AxisScaled(rotation, translation, scales)


def _scale_count(model: Model) -> int:
    return 2 if model == "anisotropic" else 1


def _versions() -> dict[str, str]:
    from importlib.metadata import version

    return {"sonocal": version("sonocal"), "numpy": np.__version__, "python": platform.python_version()}
