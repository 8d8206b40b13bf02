"""NRRD images and sequences: ``.igs.nrrd`` of PLUS, ``.seq.nrrd`` of 3D Slicer, ``.nrrd``, ``.nhdr``.

Own code, because pynrrd decodes a whole file before its size is checked, and is needed for nothing else;
it is the oracle of the tests.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, UnsupportedError
from sonocal.files import file_beside
from sonocal.files.kinds import Format
from sonocal.geometry import Array
from sonocal.recording.formats.parts.inflate import GZIP, InflatedFrames
from sonocal.recording.formats.parts.layout import Layout, assemble, check_sizes
from sonocal.recording.formats.parts.nrrd_header import ORIENTATION_KEY, STRUCTURE, TYPES, Header, read_header
from sonocal.recording.formats.parts.nrrd_write import write_nrrd
from sonocal.recording.formats.parts.written import NRRD_GEOMETRY
from sonocal.recording.frames import Frames, Image, RawFrames, no_frames
from sonocal.recording.model import Provenance, Recording

__all__ = ["FORMAT", "read_nrrd"]

SPATIAL_KINDS = ("domain", "space", "???", "none")
LIST_KINDS = ("list", "time")


@dataclass(frozen=True)
class _Axes:
    """What the stored axes are: spatial ones, that of the colours, that of the time line."""

    sizes: tuple[int, ...]
    spatial: tuple[int, ...]
    colour: int | None
    list: int | None

    @property
    def plain(self) -> bool:
        """Colour first, then space, then the time line: frames follow one another."""
        order = [*([] if self.colour is None else [self.colour]), *self.spatial]
        order += [] if self.list is None else [self.list]
        return order == sorted(order)


def read_nrrd(path: Path) -> Recording:
    """Read an NRRD image or sequence.

    Args:
        path: the file, or the ``.nhdr`` beside its data file.

    Raises:
        FormatError: the header is damaged, or does not match the data.
        UnsupportedError: a kind of NRRD that recordings do not use.
    """
    header = read_header(path)
    axes = _axes(header)
    single_slice = axes.list is not None and len(axes.spatial) == 3 and axes.sizes[axes.spatial[2]] == 1
    layout = _layout(header, axes, single_slice)
    data_path, offset = _data_place(path, header)
    frames = no_frames() if layout.image_free else _frames(header, axes, layout, data_path, offset)
    items_header = {k: v for k, v in header.fields.items() if k not in STRUCTURE}
    if single_slice or not axes.plain:  # would not fit the axes we write
        items_header = {k: v for k, v in items_header.items() if k not in NRRD_GEOMETRY}
    pairs = {k: v for k, v in header.pairs.items() if k != ORIENTATION_KEY}
    kind = "NRRD image" if axes.list is None and not header.items.columns else "NRRD sequence"
    return assemble(
        layout,
        frames,
        header.items,
        orientation=header.pairs.get(ORIENTATION_KEY, ""),
        fields=items_header | pairs,
        provenance=Provenance(
            path.name, kind, (str(path),) if data_path == path else (str(path), str(data_path))
        ),
        times=_index_times(header, axes, layout.count),
    )


def _axes(header: Header) -> _Axes:
    sizes = header.whole("sizes")
    if header.whole("dimension") != (len(sizes),) or not 2 <= len(sizes) <= 5:
        raise FormatError(
            f"{header.name}: dimension {header.need('dimension')!r} does not fit sizes {header.need('sizes')!r}; "
            "recordings have 2 to 5"
        )
    check_sizes(header.name, sizes)
    kinds = header.fields.get("kinds", "").split()
    if kinds and len(kinds) != len(sizes):
        raise FormatError(f"{header.name}: has {len(kinds)} kinds for {len(sizes)} axes")
    if not kinds:
        sequence = len(sizes) == 4 or (header.items.columns and len(sizes) == 3)
        kinds = ["domain"] * (len(sizes) - bool(sequence)) + ["list"] * bool(sequence)
    return _named_axes(header.name, sizes, [kind.lower() for kind in kinds])


def _named_axes(name: str, sizes: tuple[int, ...], kinds: Sequence[str]) -> _Axes:
    lists = [i for i, kind in enumerate(kinds) if kind in LIST_KINDS]
    spatial = [i for i, kind in enumerate(kinds) if kind in SPATIAL_KINDS]
    colours = [i for i in range(len(sizes)) if i not in lists and i not in spatial]
    if (
        len(lists) > 1
        or len(colours) > 1
        or len(spatial) not in (2, 3)
        or (colours and colours[0] > spatial[0])
    ):
        raise UnsupportedError(
            f"{name}: its axes are {' '.join(kinds)}; sequences of images have 2 or 3 domains and a list"
        )
    return _Axes(sizes, tuple(spatial), colours[0] if colours else None, lists[0] if lists else None)


def _layout(header: Header, axes: _Axes, single_slice: bool) -> Layout:
    size = tuple(axes.sizes[i] for i in axes.spatial)
    count = 1 if axes.list is None else axes.sizes[axes.list]
    spacing = _spacing(header, axes)
    if single_slice:
        size, spacing = size[:2], spacing and spacing[:2]
    channels = 1 if axes.colour is None else axes.sizes[axes.colour]
    return Layout(header.name, size, count, channels, _dtype(header, 0 in size), spacing)


def _dtype(header: Header, image_free: bool) -> np.dtype[Any]:
    if image_free:
        return np.dtype("u1")
    name = header.need("type").lower()
    code = next((code for code, names in TYPES.items() if name in names), None)
    if code is None:
        raise UnsupportedError(
            f"{header.name}: pixels of type {name[:40]!r} cannot be read; convert them to uint8"
        )
    endian = header.fields.get("endian", "little").lower()
    if endian not in ("little", "big"):
        raise FormatError(f"{header.name}: endian {endian[:40]!r} is neither little nor big")
    return np.dtype((">" if endian == "big" else "<") + code)


def _spacing(header: Header, axes: _Axes) -> tuple[float, ...] | None:
    text = header.fields.get("space directions")
    vectors = re.findall(r"none|\([^()]*\)", text) if text else header.fields.get("spacings", "").split()
    if len(vectors) != len(axes.sizes):
        return None
    try:
        lengths = [
            math.hypot(*(float(x) for x in v.strip("()").split(","))) if v != "none" else math.nan
            for v in vectors
        ]
    except ValueError:
        raise FormatError(
            f"{header.name}: its spacing {' '.join(vectors)[:60]!r} is not of numbers"
        ) from None
    return tuple(float(lengths[i]) for i in axes.spatial)


def _data_place(path: Path, header: Header) -> tuple[Path, int]:
    if header.fields.get("line skip", "0") != "0":
        raise UnsupportedError(f"{path.name}: skips lines before its pixels; convert it to a plain .nrrd")
    skip = (*header.whole("byte skip", "0"), 0)[0]
    if skip < 0:
        raise UnsupportedError(
            f"{path.name}: counts its pixels from the end of the file; convert it to a plain .nrrd"
        )
    name = header.fields.get("data file", header.fields.get("datafile"))
    if name is None:
        return path, header.end + skip
    if name.upper().startswith("LIST") or "%" in name:
        raise UnsupportedError(f"{path.name}: keeps its frames in several files; convert it to a plain .nrrd")
    data = file_beside(path, name)
    if data is None:
        raise FormatError(
            f"{path.name}: its data file {name[:80]} is not beside it; copy both files together"
        )
    return data, skip


def _frames(header: Header, axes: _Axes, layout: Layout, path: Path, offset: int) -> Frames:
    if axes.plain:
        return _stored(header, layout.count, layout.shape, layout.dtype, path, offset)
    whole = _stored(header, 1, axes.sizes[::-1], layout.dtype, path, offset)
    order = [axes.list, *axes.spatial[::-1], axes.colour]
    array_axes = tuple(len(axes.sizes) - 1 - i for i in order if i is not None)
    return _Interleaved(whole, array_axes, layout)


def _stored(  # noqa: PLR0917 - what a stream is, in the order of `RawFrames`
    header: Header, count: int, shape: tuple[int, ...], dtype: np.dtype[Any], path: Path, offset: int
) -> Frames:
    encoding = header.need("encoding").lower()
    if encoding == "raw":
        return RawFrames(path, offset, count, shape, dtype)
    if encoding in ("gz", "gzip"):
        return InflatedFrames(path, offset, None, count, shape, dtype, GZIP)
    raise UnsupportedError(f"{header.name}: encoding {encoding[:40]!r} cannot be read; use raw or gzip")


class _Interleaved(Frames):
    """Frames of which the file stores the first pixel of all, then the second: older Slicer sequences."""

    def __init__(self, whole: Frames, order: tuple[int, ...], layout: Layout) -> None:
        self._whole, self._order, self._count = whole, order, layout.count
        self._decoded: Image | None = None
        self.shape, self.dtype = layout.shape, whole.dtype

    def __len__(self) -> int:
        return self._count

    def read(self, index: int) -> Image:
        """Frame `index`; the first one asked for decodes them all."""
        if self._decoded is None:
            self._decoded = self._whole[0].transpose(self._order)
        return np.asarray(self._decoded[index]).reshape(self.shape)


def _index_times(header: Header, axes: _Axes, count: int) -> Array | None:
    """The times of a Slicer sequence, which keeps them as the index values of its list axis."""
    key = f"axis {axes.list} index values"
    if key not in header.pairs or "Timestamp" in header.items.columns:
        return None
    if header.pairs.get(f"axis {axes.list} index type", "numeric") != "numeric":
        return None
    words = header.pairs[key].split()
    try:
        times = np.array([float(word) for word in words])
    except ValueError:
        raise FormatError(f"{header.name}: the index values of its frames are not numbers") from None
    if len(times) != count or not np.isfinite(times).all():
        raise FormatError(
            f"{header.name}: has {len(times)} index values for {count} frames, or some are not finite"
        )
    return times


FORMAT = Format(
    name="PLUS and Slicer NRRD sequence, NRRD image",
    kind="recording",
    suffixes=(".nrrd", ".nhdr"),
    sniff=lambda head: head.content.startswith(b"NRRD"),
    read=read_nrrd,
    holds="raw and gzip; list axis last or (older Slicer) first; a single slice is an image; a volume without "
    "fields of items is one frame",
    write=write_nrrd,
    writes=(".nrrd",),
)
