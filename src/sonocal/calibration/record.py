"""What is in a calibration's file: its schema and its conventions."""

from __future__ import annotations

from typing import Any, Literal, TypedDict

import msgspec

from sonocal.calibration.found_phantom import FoundPhantom
from sonocal.calibration.found_targets import FoundTarget
from sonocal.calibration.sound import Sound
from sonocal.calibration.statistics import ErrorStatistics
from sonocal.findings import Diagnostic
from sonocal.registration.certificate import Certificate
from sonocal.registration.model_test import ModelTest
from sonocal.registration.noise import Drift
from sonocal.registration.options import Model

__all__ = ["CONVENTIONS", "FORMAT", "VERSION", "Kept", "Record", "Sigma"]

FORMAT: Literal["sonocal-calibration"] = "sonocal-calibration"
VERSION = 1
CONVENTIONS = (
    "probe_from_image @ (u, v, w, 1) is a place in mm in the probe marker's frame. u right, v down, w out of the "
    "slice, in px of the MF-oriented image; the origin is the centre of the first pixel; a 2D image lies at w = 0. "
    "The mm per px are inside the matrix. Covariance: of a rotation vector applied on the left (rad), a translation "
    "(mm) and the logarithm of the scale, of the scale along every axis, or of none where the scale is known."
)


class Source(TypedDict, total=False):
    """A file that something was made from."""

    input: str | None
    sha256: str | None


class Kept(Source, total=False):
    """What is read of a provenance, which may hold more."""

    options: dict[str, Any]
    recorded: dict[str, Source]
    versions: dict[str, Any]


class Sigma(msgspec.Struct):
    """The noise behind the covariance."""

    row_mm: float | None
    point_px: float | None
    segment_mm: float | None
    shared_mm: dict[str, float]
    freedom: int
    drift: Drift | None = None
    apparent: float = 0.0


class Record(msgspec.Struct, kw_only=True):
    """The file's fields, in the order they are written."""

    format: Literal["sonocal-calibration"]
    version: int
    created: str
    conventions: str = ""
    probe_from_image: list[list[float]]
    model: Model
    scale_mm_per_px: list[float]
    rotation_wxyz: list[float]
    translation_mm: list[float]
    covariance: list[list[float]] | None
    sigma: Sigma
    area_px: list[list[float]]
    image_size_px: list[int] | None = None
    seen_px: list[list[float]] | None = None
    fit: ErrorStatistics
    test: ErrorStatistics | None
    residuals_mm: list[float]
    inlier: list[bool]
    latency_s: float | None
    latency_interval_s: tuple[float, float] | None = None
    sound: Sound | None = None
    targets: dict[str, FoundTarget] = {}
    phantom: FoundPhantom | None = None
    certificate: Certificate = "not shown"
    models: list[ModelTest] = []
    diagnostics: list[Diagnostic]
    provenance: dict[str, Any]
