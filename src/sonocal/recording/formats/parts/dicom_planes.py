"""Where the planes of an Enhanced US Volume lie, and which of them make a volume. DICOM PS3.3, C.8.24."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import FormatError, UnsupportedError
from sonocal.geometry import Array
from sonocal.recording.formats.parts.dicom_file import DicomFile, Item

__all__ = ["Planes"]

TISSUE = "TISSUE_INTENSITY"
# Shares of the step between planes by which they may be out of place.
UNEVEN = 0.01
PARALLEL = 1e-4

Numbers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Planes:
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
    def of(cls, file: DicomFile, count: int) -> Planes:
        """Where the `count` images of a file lie.

        Raises:
            FormatError: it does not say of each where it lies.
            UnsupportedError: they are not parallel, or not one behind the other.
        """
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
