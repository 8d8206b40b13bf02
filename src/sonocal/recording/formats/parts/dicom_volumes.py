"""Volumes in DICOM: the standard's Enhanced US Volume, and the Cartesian volumes that Philips' QLAB exports.

Both keep a volume as parallel images. The first says of each where it lies (DICOM PS3.3, C.8.24); the second only how
many make a volume, in private elements that several open readers agree upon (MITK, SlicerHeart).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import FormatError, UnsupportedError
from sonocal.geometry import Array
from sonocal.recording.formats.parts.dicom_file import DicomFile, Item
from sonocal.recording.formats.parts.dicom_pixels import DicomFrames
from sonocal.recording.frames import Frames, Image, SelectedFrames, check_frame_size

__all__ = ["ENHANCED_US_VOLUME", "PHILIPS_VOLUME", "Volumes", "enhanced_volumes", "philips_volumes"]

ENHANCED_US_VOLUME = "1.2.840.10008.5.1.4.1.1.6.2"
PHILIPS_VOLUME = "1.2.840.113543.6.6.1.3.10002"
SLICES, SLICE_UNITS, SLICE_DELTA = 0x30011001, 0x30011002, 0x30011003
SLICES_LIMIT = 1 << 16
CENTIMETRES = 3
MM_PER_CM = 10.0
TISSUE = "TISSUE_INTENSITY"
# Shares of the step between planes by which they may be out of place.
UNEVEN = 0.01
PARALLEL = 1e-4

Numbers = NDArray[np.int64]


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
    planes = _Planes.of(file, count)
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


@dataclass(frozen=True, eq=False)
class _Planes:
    """Where each image of an Enhanced US Volume lies, mm and s.

    Attributes:
        rows: (P,) numbers of the images that are of tissue.
        depths: (P,) mm along u x v.
        moments: (P,) s, or whatever else tells volumes apart; NaN where the file does not say.
        timed: whether moments are s.
        in_plane_mm: (v, u) mm/px; None where it is not said.
        apart_mm: from plane to plane, as it is said; NaN where it is not.
    """

    rows: Numbers
    depths: Array
    moments: Array
    timed: bool
    in_plane_mm: Array | None
    apart_mm: float

    @classmethod
    def of(cls, file: DicomFile, count: int) -> _Planes:
        groups = file.items("PerFrameFunctionalGroupsSequence")
        shared = (*file.items("SharedFunctionalGroupsSequence"), Item(file.name, {}))[0]
        if len(groups) != count:
            raise FormatError(
                f"{file.name}: says where {len(groups)} of its {count} planes lie; export it again"
            )
        macros = [_Macros(own, shared) for own in groups]
        rows = _of_tissue(file.name, macros)
        macros = [macros[i] for i in rows]
        moments = np.array(
            [one.number("TemporalPositionSequence", "TemporalPositionTimeOffset") for one in macros]
        )
        timed = bool(np.isfinite(moments).all())
        if not timed:
            moments = np.array(
                [one.number("FrameContentSequence", "TemporalPositionIndex") for one in macros]
            )
        measures = macros[0].item("PixelMeasuresSequence")
        apart = [measures.number(key, 0) for key in ("SpacingBetweenSlices", "SliceThickness")]
        return cls(
            rows,
            _depths(file.name, macros),
            moments,
            timed,
            measures.numbers("PixelSpacing", 2),
            next((abs(one) for one in apart if one), np.nan),
        )

    def stacked(self, name: str) -> tuple[Numbers, Array]:
        """(N, S) numbers of the images that make each volume, in the order of w, and (N,) s."""
        keys = self._keys()
        _, starts, sizes = np.unique(keys, return_index=True, return_counts=True)
        if (sizes != sizes[0]).any():
            odd = int(np.argmax(sizes != sizes[0]))
            raise FormatError(
                f"{name}: its first volume has {sizes[0]} planes and number {odd + 1} has {sizes[odd]}; export it again"
            )
        order = np.lexsort((self.depths, keys)).reshape(len(sizes), -1)
        _refuse_uneven(name, self.depths[order])
        times = self.moments[starts] if self.timed else np.full(len(sizes), np.nan)
        return self.rows[order], times

    def _keys(self) -> Array:
        """(P,) what is equal in planes of one volume: the moment, or how often a plane was there before."""
        different = len(np.unique(self.depths.round(6)))
        if np.isfinite(self.moments).all() and len(np.unique(self.moments)) * different <= len(self.rows):
            return self.moments
        seen: dict[float, int] = {}
        keys = np.empty(len(self.rows))
        for i, depth in enumerate(self.depths.round(6).tolist()):
            keys[i] = seen[depth] = seen.get(depth, -1) + 1
        return keys

    def spacing(self, volumes: Numbers) -> tuple[float, ...] | None:
        """(u, v, w) mm/px."""
        if self.in_plane_mm is None or not (self.in_plane_mm > 0).all():
            return None
        depths = self.depths[np.isin(self.rows, volumes[0])]
        planes = volumes.shape[1]
        apart = np.ptp(depths) / (planes - 1) if planes > 1 else self.apart_mm
        spacing = (float(self.in_plane_mm[1]), float(self.in_plane_mm[0]))
        return (*spacing, float(apart)) if np.isfinite(apart) or planes == 1 else None


@dataclass(frozen=True)
class _Macros:
    """What is said of one image: of its own, or shared by all."""

    own: Item
    shared: Item

    def item(self, sequence: str) -> Item:
        """The one item of a sequence; an empty one where it is absent."""
        return (*self.own.items(sequence), *self.shared.items(sequence), Item(self.own.name, {}))[0]

    def number(self, sequence: str, key: str) -> float:
        """A number in it, or NaN."""
        return self.item(sequence).number(key, np.nan)


def _of_tissue(name: str, macros: Sequence[_Macros]) -> Numbers:
    """(P,) which images show tissue; all, where the file says of none what it shows."""
    kinds = [one.item("ImageDataTypeSequence").text("DataType") for one in macros]
    if set(kinds) <= {kinds[0]}:
        return np.arange(len(kinds), dtype=np.int64)
    rows = np.array([i for i, kind in enumerate(kinds) if kind == TISSUE], dtype=np.int64)
    if not len(rows):
        raise UnsupportedError(
            f"{name}: holds volumes of {', '.join(sorted(set(kinds)))[:100]} and none of {TISSUE}"
        )
    return rows


def _depths(name: str, macros: Sequence[_Macros]) -> Array:
    """(P,) mm of parallel planes that lie one behind the other, along u x v."""
    places = [one.item("PlanePositionVolumeSequence").numbers("ImagePositionVolume", 3) for one in macros]
    if any(place is None for place in places):
        raise FormatError(
            f"{name}: is a volume that does not say where its planes lie (Plane Position (Volume) is missing); "
            "export it again"
        )
    standard = np.array([1.0, 0, 0, 0, 1, 0])
    turns = [
        one.item("PlaneOrientationVolumeSequence").numbers("ImageOrientationVolume", 6) for one in macros
    ]
    axes = np.array([standard if turn is None else turn for turn in turns]).reshape(-1, 2, 3)
    if np.abs(axes - axes[0]).max() > PARALLEL:
        raise UnsupportedError(
            f"{name}: its planes are not parallel, which no volume that is read has; resample it"
        )
    if np.abs(axes[0] @ axes[0].T - np.eye(2)).max() > PARALLEL:
        raise FormatError(
            f"{name}: its rows and columns are not at right angles of unit length; export it again"
        )
    positions = np.array(places, dtype=float)
    across = positions @ axes[0].T
    depths = positions @ np.cross(axes[0, 0], axes[0, 1])
    if np.abs(across - across[0]).max() > UNEVEN * max(float(np.ptp(depths)) / len(depths), 1e-3):
        raise UnsupportedError(f"{name}: its planes do not lie one behind the other; resample it")
    return np.asarray(depths)


def _refuse_uneven(name: str, depths: Array) -> None:
    """Refuse volumes (N, S) whose planes are not evenly spaced, or that do not all lie in one place."""
    if depths.shape[1] > 1:
        step = (depths[0, -1] - depths[0, 0]) / (depths.shape[1] - 1)
        even = depths[0, 0] + step * np.arange(depths.shape[1])
        if step <= 0 or np.abs(depths - even).max() > UNEVEN * step:
            raise UnsupportedError(
                f"{name}: its planes are not evenly spaced, or its volumes lie apart; resample it"
            )


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
