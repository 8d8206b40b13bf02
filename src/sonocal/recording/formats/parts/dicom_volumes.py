"""Volumes in DICOM: the standard's Enhanced US Volume, and the Cartesian volumes that Philips' QLAB exports.

Both keep a volume as parallel images. The first says of each where it lies (DICOM PS3.3, C.8.24); the second only how
many make a volume, in private elements that several open readers agree upon (MITK, SlicerHeart).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonocal.errors import UnsupportedError
from sonocal.geometry import Array
from sonocal.recording.formats.parts.dicom_file import DicomFile
from sonocal.recording.formats.parts.dicom_pixels import DicomFrames
from sonocal.recording.formats.parts.dicom_planes import Planes
from sonocal.recording.frames import Frames, Image, SelectedFrames, check_frame_size

__all__ = ["ENHANCED_US_VOLUME", "PHILIPS_VOLUME", "Volumes", "enhanced_volumes", "philips_volumes"]

ENHANCED_US_VOLUME = "1.2.840.10008.5.1.4.1.1.6.2"
PHILIPS_VOLUME = "1.2.840.113543.6.6.1.3.10002"
SLICES, SLICE_UNITS, SLICE_DELTA = 0x30011001, 0x30011002, 0x30011003
SLICES_LIMIT = 1 << 16
CENTIMETRES = 3
MM_PER_CM = 10.0


@dataclass(frozen=True, eq=False)
class Volumes:
    """What a file's images make together.

    Attributes:
        frames: the volumes; images, where each has a single plane.
        dimension: 3 of volumes, 2 of images.
        spacing_mm: (u, v[, w]) mm/px, or None.
        times: (N,) s from the first; NaN where the file does not say.
    """

    frames: Frames
    dimension: int
    spacing_mm: tuple[float, ...] | None
    times: Array


class StackedFrames(Frames):
    """Volumes of which each plane is an image of another sequence."""

    def __init__(self, name: str, planes: Frames, rows: Sequence[Sequence[int]]) -> None:
        self._planes, self._rows = planes, rows
        self.shape, self.dtype = (len(rows[0]), *planes.shape), planes.dtype
        check_frame_size(name, self.shape, self.dtype)

    def __len__(self) -> int:
        return len(self._rows)

    def read(self, index: int) -> Image:
        """Volume `index`."""
        volume = np.empty(self.shape, self.dtype)
        for w, row in enumerate(self._rows[index]):
            volume[w] = self._planes.read(row)
        volume.flags.writeable = False
        return volume


def enhanced_volumes(file: DicomFile) -> Volumes:
    """The volumes of an Enhanced US Volume: u and v along rows and columns of its planes, w along u x v.

    Raises:
        FormatError: planes are missing, or not said to lie anywhere.
        UnsupportedError: they are not parallel, not one behind the other, or not evenly spaced.
    """
    count = file.frame_count
    planes = Planes.of(file, count)
    volumes, times = planes.stacked(file.name)
    frames = DicomFrames(file, count=count)
    return _volumes(file.name, frames, volumes.tolist(), planes.spacing(volumes), times)


def philips_volumes(file: DicomFile) -> Volumes:
    """The volumes that QLAB exports as "Cartesian DICOM": as many images a volume as a private element says.

    Raises:
        UnsupportedError: the file does not say so: it is of another kind of Philips' private volumes.
    """
    slices = _private_number(file, SLICES, "<I")
    if slices is None or not 1 <= slices <= SLICES_LIMIT:
        raise UnsupportedError(
            f"{file.name}: holds Philips' private 3D ultrasound ({PHILIPS_VOLUME}) in a layout that is not public; "
            "export Cartesian DICOM from QLAB, or NRRD from 3D Slicer"
        )
    count, depth = file.frame_count, int(slices)
    frames = DicomFrames(file, count=count * depth)
    rows = [range(depth * i, depth * (i + 1)) for i in range(count)]
    times = np.arange(count) * file.number("FrameTime", np.nan) / 1000
    return _volumes(file.name, frames, rows, _philips_spacing(file), times)


def _volumes(
    name: str, planes: Frames, rows: Sequence[Sequence[int]], spacing: tuple[float, ...] | None, times: Array
) -> Volumes:
    if len(rows[0]) == 1:  # a lone plane is an image
        return Volumes(SelectedFrames(planes, [row[0] for row in rows]), 2, spacing and spacing[:2], times)
    return Volumes(StackedFrames(name, planes, rows), 3, spacing, times)


def _philips_spacing(file: DicomFile) -> tuple[float, ...] | None:
    deltas = [file.number(f"PhysicalDelta{axis}", 0) for axis in "XY"] + [
        _private_number(file, SLICE_DELTA, "<d") or 0
    ]
    units = [file.number(f"PhysicalUnits{axis}Direction", CENTIMETRES) for axis in "XY"]
    units.append(_private_number(file, SLICE_UNITS, "<H") or CENTIMETRES)
    spacing = tuple(MM_PER_CM * abs(delta) for delta in deltas)
    return spacing if set(units) == {CENTIMETRES} and all(0 < one < np.inf for one in spacing) else None


def _private_number(file: DicomFile, tag: int, form: str) -> float | None:
    """A number of a private element, whose type a file without types does not say."""
    value = file.get(tag)
    if isinstance(value, bytes):
        return float(struct.unpack(form, value)[0]) if len(value) == struct.calcsize(form) else None
    return None if value is None else file.number(tag, 0)
