"""The pixels of DICOM files: decoded by pydicom when they are asked for, and brought to what they mean."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, UnsupportedError
from sonocal.files import file_size
from sonocal.recording.formats.parts.bounded_file import BoundedFile
from sonocal.recording.formats.parts.dicom_file import DicomFile
from sonocal.recording.formats.parts.dicom_palette import palette_of
from sonocal.recording.frames import PICTURE_LIMIT, Frames, Image, check_frame_size, frame_bytes

__all__ = ["DicomFrames"]

# The least that a compressed image takes: the head of its fragment.
FRAGMENT = 8

Change = Callable[[Image], Image]


class DicomFrames(Frames):
    """Images of DICOM files: grey, or colour as red, green and blue; bright is a large number."""

    def __init__(self, first: DicomFile, paths: Sequence[Path] = (), count: int = 1) -> None:
        """The `count` images of one file, or those of files of one image each.

        Args:
            first: the file, or the first of several.
            paths: the files, where they are several.
            count: of images in a file.
        """
        self._paths, self._count = paths, count
        self._opened = (first.path, _Pixels(first, count))
        self.shape, self.dtype = self._opened[1].shape, self._opened[1].dtype

    def __len__(self) -> int:
        return len(self._paths) or self._count

    def read(self, index: int) -> Image:
        """Frame `index`."""
        at, pixels = self._opened
        path, place = (self._paths[index], 0) if self._paths else (at, index)
        if path != at:
            self._opened = _, pixels = path, _Pixels(DicomFile.open(path), self._count)
        if (pixels.shape, pixels.dtype) != (self.shape, self.dtype):
            raise FormatError(
                f"{path.name}, frame {index}: is {pixels.shape} {pixels.dtype} where the first frame is "
                f"{self.shape} {self.dtype}"
            )
        image = pixels.read(index, place)
        image.flags.writeable = False
        return image


class _Pixels:
    """The images of one file: how they are written, and what their values mean."""

    def __init__(self, file: DicomFile, count: int) -> None:
        if file.pixels_at is None:
            raise FormatError(
                f"{file.name}: holds no pixels that can be read; export it from the scanner as images"
            )
        self._file, self._count = file, count
        rows, columns, bits = (int(file.number(key, 0)) for key in ("Rows", "Columns", "BitsAllocated"))
        channels = int(file.number("SamplesPerPixel", 1))
        if rows < 1 or columns < 1 or channels not in (1, 3) or bits not in (8, 16):
            raise FormatError(
                f"{file.name}: states {rows} x {columns} pixels of {channels} x {bits} bits; no image has that"
            )
        signed = int(file.number("PixelRepresentation", 0))
        self._stored = (rows, columns) + ((3,) if channels == 3 else ())
        self._type = np.dtype(f"{'i' if signed else 'u'}{bits // 8}")
        check_frame_size(file.name, self._stored, self._type, PICTURE_LIMIT)
        _refuse_short(file, count, frame_bytes(self._stored, self._type))
        self._change, self.dtype, deep = _meaning(file, self._type, channels)
        self.shape = (rows, columns) + ((3,) if deep == 3 else ())

    def read(self, index: int, place: int) -> Image:
        """Image `place` of the file, which is frame `index`."""
        name = f"{self._file.name}, frame {index}"
        try:
            image = self._decoded(place)
        except NotImplementedError as error:
            raise UnsupportedError(f"{name}: cannot be decoded ({error})") from None
        except Exception as error:  # pydicom raises many kinds for damaged pixels
            if "missing dependencies" in str(error):
                raise UnsupportedError(
                    f"{self._file.name}: its compression needs a codec; pip install pylibjpeg pylibjpeg-libjpeg"
                ) from None
            raise FormatError(f"{name}: cannot be decoded ({str(error)[:80]})") from None
        if image.shape != self._stored:
            raise FormatError(f"{name}: is {image.shape} where its header states {self._stored}")
        return self._change(image.astype(self._type, copy=False))

    def _decoded(self, place: int) -> Image:
        from pydicom.pixels.decoders.base import get_decoder
        from pydicom.pixels.utils import as_pixel_options

        file = self._file
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            options = as_pixel_options(file.data, number_of_frames=self._count, pixel_keyword="PixelData")
            options |= {} if file.pixels_vr is None else {"pixel_vr": file.pixels_vr}
            with BoundedFile(file.path) as stream:
                stream.seek(file.pixels_at or 0)
                image, _ = get_decoder(file.transfer_syntax).as_array(stream, index=place, **options)
        return np.asarray(image)


def _refuse_short(file: DicomFile, count: int, size: int) -> None:
    """Refuse a file that cannot hold its `count` images of `size` bytes, before anything is made that long."""
    there = max(file_size(file.path) - (file.pixels_at or 0), 0)
    try:
        compressed = file.transfer_syntax.is_encapsulated
    except (AttributeError, ValueError):
        raise UnsupportedError(
            f"{file.name}: its pixels are written in a way that is not known ({str(file.transfer_syntax)[:70]!r})"
        ) from None
    if compressed:
        least = FRAGMENT
    else:  # of 4:2:2, two of three values are stored
        least = size * 2 // 3 if file.text("PhotometricInterpretation") == "YBR_FULL_422" else size
    if count * least > there:
        raise FormatError(
            f"{file.name}: holds {there} bytes of pixels where its header asks for {count} frames of "
            f"{least} or more; it was cut short, copy it again"
        )


def _meaning(file: DicomFile, stored: np.dtype[Any], channels: int) -> tuple[Change, np.dtype[Any], int]:
    """What brings stored values to brightness, the type of what comes out, and its channels."""
    kind = file.text("PhotometricInterpretation")
    if kind == "PALETTE COLOR" and channels == 1:
        table = palette_of(file, stored)
        least = np.iinfo(stored).min
        return (lambda image: table[image.astype(np.int64) - least]), table.dtype, table[:1].size
    if kind == "MONOCHROME1":
        bits = int(np.clip(file.number("BitsStored", 8 * stored.itemsize), 1, 8 * stored.itemsize))
        brightest = stored.type(
            -1 if stored.kind == "i" else (1 << bits) - 1
        )  # the least and the largest add up to it
        return (lambda image: brightest - image), stored, 1
    return (lambda image: image), stored, channels
