"""DICOM ultrasound: one multi-frame file, or one file a frame; images and volumes."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import numpy as np

from sonocal.errors import UnsupportedError
from sonocal.files.kinds import Format
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.recording.formats.kretz import read_kretz
from sonocal.recording.formats.parts.dicom_file import DicomFile
from sonocal.recording.formats.parts.dicom_pixels import DicomFrames
from sonocal.recording.formats.parts.dicom_private import kretz_at, private_volumes
from sonocal.recording.formats.parts.dicom_regions import scale_of, shared_scale
from sonocal.recording.formats.parts.dicom_volumes import (
    ENHANCED_US_VOLUME,
    PHILIPS_VOLUME,
    enhanced_volumes,
    philips_volumes,
)
from sonocal.recording.model import ImageGeometry, Provenance, Recording

__all__ = ["FORMAT", "SUFFIXES", "read_dicom", "read_dicom_files"]

SUFFIXES = (".dcm", ".ima")
VOLUMES = {ENHANCED_US_VOLUME: enhanced_volumes, PHILIPS_VOLUME: philips_volumes}


def read_dicom(path: Path) -> Recording:
    """Read a DICOM file of images or volumes.

    Times count from the file's acquisition or content time, s of the day, where it has one; frames
    follow by ``FrameTimeVector``, ``FrameTime`` or the frame rate, volumes by what is said of their planes.

    Raises:
        UnsupportedError: pydicom is not installed, or lacks a codec for the pixels; or volumes are not even.
        FormatError: the file is no DICOM image.
    """
    file = DicomFile.open(path)
    if (place := kretz_at(file)) is not None:
        return read_kretz(path, place)
    start = _start(file)
    start = 0.0 if np.isnan(start) else start
    provenance = Provenance(path.name, "DICOM", (str(path),))
    if file.sop_class in VOLUMES:
        found = VOLUMES[file.sop_class](file)
        geometry = ImageGeometry.of(found.frames, found.dimension, spacing_mm=found.spacing_mm)
        times = start + (found.times if len(found.times) > 1 else np.zeros(1))
        return Recording(times=times, frames=found.frames, image=geometry, provenance=provenance)
    private = private_volumes(file)
    frames = DicomFrames(file, count=file.frame_count)
    spacing, said = scale_of(file)
    return _images(frames, start + _steps(file, len(frames)), provenance, spacing, (*private, *said))


def read_dicom_files(paths: Sequence[Path], name: str) -> Recording:
    """Read single-frame DICOM files, in the order of their acquisition times.

    Raises:
        UnsupportedError: as `read_dicom`; or a file holds several images.
        FormatError: a file is no DICOM image.
    """
    times, scales = np.empty(len(paths)), []
    for i, path in enumerate(paths):
        file = DicomFile.open(path)
        if (count := file.frame_count) > 1 or file.sop_class in VOLUMES:
            raise UnsupportedError(
                f"{name}: {path.name} holds {count} images, and a folder files of one image each; name that file alone"
            )
        times[i] = _start(file)
        scales.append(scale_of(file))
    if np.isnan(times).any():
        times = np.full(len(paths), np.nan)
    order = np.argsort(times, kind="stable")  # NaN keeps the order of the names
    ordered = [paths[i] for i in order]
    provenance = Provenance(name, "DICOM files", tuple(map(str, ordered)))
    frames = DicomFrames(DicomFile.open(ordered[0]), ordered)
    return _images(frames, times[order], provenance, *shared_scale([scales[i] for i in order]))


def _images(
    frames: DicomFrames,
    times: Array,
    provenance: Provenance,
    spacing: tuple[float, float] | None,
    said: tuple[Diagnostic, ...],
) -> Recording:
    geometry = ImageGeometry.of(frames, spacing_mm=spacing)
    return Recording(times=times, frames=frames, image=geometry, provenance=provenance, diagnostics=said)


def _steps(file: DicomFile, count: int) -> Array:
    """(N,) s from the first frame; NaN where the file does not say."""
    if (
        np.size(file.get("FrameTimeVector")) == count
        and (steps := file.numbers("FrameTimeVector", count)) is not None
    ):
        return np.asarray(np.cumsum(steps) / 1000.0)
    step_ms = file.number("FrameTime", 0.0)
    if step_ms <= 0:
        rate = file.number("CineRate", 0.0) or file.number("RecommendedDisplayFrameRate", 0.0)
        step_ms = 1000.0 / rate if rate > 0 else np.nan
    return np.asarray(np.arange(count) * step_ms / 1000.0) if count > 1 else np.zeros(1)


def _start(file: DicomFile) -> float:
    """Seconds of the day at which the first frame was taken; NaN where the file does not say."""
    try:
        for key, form in (
            ("AcquisitionDateTime", "%Y%m%d%H%M%S"),
            ("AcquisitionTime", "%H%M%S"),
            ("ContentTime", "%H%M%S"),
        ):
            text = file.text(key).split("+")[0].split("&")[0]
            if text:
                whole, _, part = text.partition(".")
                moment = datetime.strptime(whole, form)
                return moment.hour * 3600 + moment.minute * 60 + moment.second + float(f"0.{part or 0}")
    except ValueError:
        return float("nan")
    return float("nan")


FORMAT = Format(
    name="DICOM",
    kind="recording",
    suffixes=SUFFIXES,
    sniff=lambda head: head.content[128:132] == b"DICM",
    read=read_dicom,
    holds="multi-frame, 8 and 16 bit, grey (MONOCHROME1 inverted), colour, palettes; Enhanced US Volume; the Cartesian "
    "volumes of Philips' QLAB, GE's Kretz volumes; other private volumes are named",
    needs=("pydicom",),
)
