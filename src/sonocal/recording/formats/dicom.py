"""DICOM ultrasound: one multi-frame file, or one file a frame."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, UnsupportedError
from sonocal.files import file_size
from sonocal.files.kinds import Format
from sonocal.geometry import Array
from sonocal.recording.formats.parts.bounded_file import BoundedFile
from sonocal.recording.formats.parts.layout import COUNT_LIMIT
from sonocal.recording.formats.parts.packages import needed
from sonocal.recording.frames import PICTURE_LIMIT, Frames, Image, check_frame_size
from sonocal.recording.model import ImageGeometry, Provenance, Recording

__all__ = ["FORMAT", "SUFFIXES", "read_dicom", "read_dicom_files"]

SUFFIXES = (".dcm", ".ima")
CENTIMETRES = 3  # PhysicalUnitsXDirection of an ultrasound region
MM_PER_CM = 10.0


def read_dicom(path: Path) -> Recording:
    """Read a multi-frame DICOM file.

    Times count from the file's acquisition or content time, s of the day, where it has one; frames
    follow by ``FrameTimeVector``, ``FrameTime`` or the frame rate.

    Raises:
        UnsupportedError: pydicom is not installed, or lacks a codec for the pixels.
        FormatError: the file is no DICOM image.
    """
    header = _header(path)
    count = int(_number(path, header, "NumberOfFrames", 1))
    if not 1 <= count <= COUNT_LIMIT:
        raise FormatError(f"{path.name}: states {count} frames; is it damaged?")
    frames = DicomFrames([(path, i) for i in range(count)], header)
    start = _start(header)
    times = (0.0 if np.isnan(start) else start) + _steps(path, header, count)
    return _recording(Provenance(path.name, "DICOM", (str(path),)), frames, times, header)


def read_dicom_files(paths: Sequence[Path], name: str) -> Recording:
    """Read single-frame DICOM files, in the order of their acquisition times."""
    headers = [_header(path) for path in paths]
    times = np.array([_start(header) for header in headers])
    if np.isnan(times).any():
        times = np.full(len(paths), np.nan)
    order = np.argsort(times, kind="stable")  # NaN keeps the order of the names
    frames = DicomFrames([(paths[i], 0) for i in order], headers[0])
    read = tuple(str(paths[i]) for i in order)
    return _recording(Provenance(name, "DICOM files", read), frames, times[order], headers[0])


class DicomFrames(Frames):
    """Frames of DICOM files, decoded by pydicom."""

    def __init__(self, places: Sequence[tuple[Path, int]], header: Any) -> None:
        self._places = places
        name = places[0][0].name
        rows, columns = (int(_number(places[0][0], header, key, 0)) for key in ("Rows", "Columns"))
        channels = int(_number(places[0][0], header, "SamplesPerPixel", 1))
        bits = int(_number(places[0][0], header, "BitsAllocated", 0))
        if rows < 1 or columns < 1 or channels not in (1, 3) or bits not in (8, 16):
            raise FormatError(
                f"{name}: states {rows} x {columns} pixels of {channels} x {bits} bits; no image has that"
            )
        signed = int(_number(places[0][0], header, "PixelRepresentation", 0))
        self.dtype = np.dtype(f"{'i' if signed else 'u'}{bits // 8}")
        self.shape = (rows, columns) + ((3,) if channels == 3 else ())
        check_frame_size(name, self.shape, self.dtype, PICTURE_LIMIT)

    def __len__(self) -> int:
        return len(self._places)

    def read(self, index: int) -> Image:
        """Frame `index`."""
        path, place = self._places[index]
        from pydicom.pixels.utils import pixel_array

        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                with BoundedFile(path) as file:
                    image = np.asarray(pixel_array(file, index=place))
        except NotImplementedError as error:
            raise UnsupportedError(f"{path.name}, frame {index}: cannot be decoded ({error})") from None
        except Exception as error:  # pydicom raises many kinds for damaged pixels
            if "missing dependencies" in str(error):
                raise UnsupportedError(
                    f"{path.name}: its compression needs a codec; pip install pylibjpeg pylibjpeg-libjpeg"
                ) from None
            raise FormatError(f"{path.name}, frame {index}: cannot be decoded ({str(error)[:80]})") from None
        if image.shape != self.shape:
            raise FormatError(
                f"{path.name}, frame {index}: is {image.shape} where the first frame is {self.shape}"
            )
        image = image.astype(self.dtype, copy=False)
        image.flags.writeable = False
        return image


def _header(path: Path) -> Any:
    file_size(path)
    pydicom = needed("pydicom", path, "DICOM needs pydicom")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with BoundedFile(path) as file:
                return pydicom.dcmread(file, stop_before_pixels=True, defer_size=None)
    except Exception as error:  # pydicom raises many kinds for damaged files
        raise FormatError(f"{path.name}: is not a DICOM file ({str(error)[:80]})") from None


def _recording(provenance: Provenance, frames: DicomFrames, times: Array, header: Any) -> Recording:
    geometry = ImageGeometry.of(frames, spacing_mm=_spacing(header))
    return Recording(times=times, frames=frames, image=geometry, provenance=provenance)


def _spacing(header: Any) -> tuple[float, ...] | None:
    """(u, v) mm/px from the ultrasound region, or from PixelSpacing, which is (row, column)."""
    try:
        for region in header.get("SequenceOfUltrasoundRegions") or ():
            if region.PhysicalUnitsXDirection == region.PhysicalUnitsYDirection == CENTIMETRES:
                spacing = (MM_PER_CM * abs(region.PhysicalDeltaX), MM_PER_CM * abs(region.PhysicalDeltaY))
                return tuple(float(s) for s in spacing) if all(0 < s < np.inf for s in spacing) else None
        if pixel := header.get("PixelSpacing"):
            return float(pixel[1]), float(pixel[0])
    except (AttributeError, TypeError, ValueError, IndexError, KeyError):
        return None
    return None


def _steps(path: Path, header: Any, count: int) -> Array:
    """(N,) s from the first frame; NaN where the file does not say."""
    vector = header.get("FrameTimeVector")
    if vector is not None and np.size(vector) == count:
        return np.asarray(np.cumsum(np.asarray(vector, dtype=float)) / 1000.0)
    step_ms = _number(path, header, "FrameTime", 0.0)
    if step_ms <= 0:
        rate = _number(path, header, "CineRate", 0.0) or _number(
            path, header, "RecommendedDisplayFrameRate", 0.0
        )
        step_ms = 1000.0 / rate if rate > 0 else np.nan
    return np.asarray(np.arange(count) * step_ms / 1000.0) if count > 1 else np.zeros(1)


def _start(header: Any) -> float:
    """Seconds of the day at which the first frame was taken; NaN where the file does not say."""
    try:
        for key, form in (
            ("AcquisitionDateTime", "%Y%m%d%H%M%S"),
            ("AcquisitionTime", "%H%M%S"),
            ("ContentTime", "%H%M%S"),
        ):
            text = str(header.get(key, "") or "").split("+")[0].split("&")[0]
            if text:
                whole, _, part = text.partition(".")
                moment = datetime.strptime(whole, form)
                return moment.hour * 3600 + moment.minute * 60 + moment.second + float(f"0.{part or 0}")
    except ValueError:
        return float("nan")
    return float("nan")


def _number(path: Path, header: Any, key: str, default: float) -> float:
    try:
        value = header.get(key)
        number = default if value in (None, "") else float(value)
    except (TypeError, ValueError, OverflowError, AttributeError):
        number = np.nan
    except Exception as error:  # values are parsed only now, and may be damaged
        raise FormatError(f"{path.name}: its {key} cannot be read ({str(error)[:60]})") from None
    if not np.isfinite(number):
        raise FormatError(f"{path.name}: its {key} is not a number")
    return number


FORMAT = Format(
    name="DICOM",
    kind="recording",
    suffixes=SUFFIXES,
    sniff=lambda head: head.content[128:132] == b"DICM",
    read=read_dicom,
    holds="multi-frame, 8 and 16 bit, grey and colour",
    needs=("pydicom",),
)
