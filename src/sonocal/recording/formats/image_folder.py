"""Images in files of their own (PNG, ... or DICOM): one, or a folder of them, and how they are stamped.

Times come from ``frames.csv`` in the folder (columns ``file`` and a time such as ``time_s``), or from the
files' names where each ends with decimal seconds (``frame_12.345.png``). Without either there are none.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, InputError, UnsupportedError
from sonocal.files import file_size, read_text, reading
from sonocal.files.tables import parse_table
from sonocal.geometry import Array
from sonocal.recording.formats.dicom import read_dicom_files
from sonocal.recording.formats.pose_csv import TIME_COLUMNS
from sonocal.recording.frames import PICTURE_LIMIT, Frames, Image, check_frame_size
from sonocal.recording.model import ImageGeometry, Provenance, Recording

__all__ = ["STAMPS", "is_image", "read_image_file", "read_image_folder"]

IMAGE_SUFFIXES = (".png", ".bmp", ".tif", ".tiff", ".jpg", ".jpeg")
IMAGE_STARTS = (b"\x89PNG", b"\xff\xd8\xff", b"II*\0", b"MM\0*")
DICOM_SUFFIXES = (".dcm", ".ima")
STAMPS = "frames.csv"
MODES = {"L": "u1", "RGB": "u1", "I;16": "u2", "F": "f4"}


def read_image_folder(folder: Path) -> Recording:
    """Read a folder of images.

    Raises:
        InputError: there are none, or ``frames.csv`` does not fit them.
        FormatError: a file is no image, or differs in size.
        UnsupportedError: Pillow or pydicom is not installed.
    """
    name = folder.resolve().name
    with reading(folder):
        entries = sorted(folder.iterdir(), key=lambda p: _natural(p.name))
    images = [p for p in entries if p.suffix.lower() in IMAGE_SUFFIXES and p.is_file()]
    dicoms = [p for p in entries if p.suffix.lower() in DICOM_SUFFIXES and p.is_file()]
    if not images and not dicoms:
        raise InputError(f"{name}: holds no image files ({', '.join(IMAGE_SUFFIXES + DICOM_SUFFIXES)})")
    if images and dicoms:
        raise InputError(f"{name}: holds both DICOM files and other images; keep one kind in it")
    if dicoms:
        return read_dicom_files(dicoms, name)
    images, times, paths = _stamped(folder, images)
    return _recording(images, times, Provenance(name, "images", paths))


def is_image(head: bytes) -> bool:
    """Whether a file that starts so is an image that Pillow may read."""
    return head.startswith(IMAGE_STARTS) or (head.startswith(b"BM") and b"\0" in head)


def read_image_file(path: Path) -> Recording:
    """Read a single image: a recording of one frame without time or poses.

    Raises:
        FormatError: the file is no image.
        UnsupportedError: Pillow is not installed.
    """
    return _recording([path], np.array([np.nan]), Provenance(path.name, "image", (str(path),)))


def _recording(images: Sequence[Path], times: Array, provenance: Provenance) -> Recording:
    frames = ImageFiles(images)
    return Recording(times=times, frames=frames, image=ImageGeometry.of(frames), provenance=provenance)


class ImageFiles(Frames):
    """Frames in files of their own, decoded by Pillow."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths, self._pillow = paths, _pillow(paths[0])
        size, mode = self._look(paths[0])
        self.dtype = np.dtype(MODES[mode])
        self.shape = (size[1], size[0]) + ((3,) if mode == "RGB" else ())
        check_frame_size(paths[0].name, self.shape, self.dtype, PICTURE_LIMIT)

    def __len__(self) -> int:
        return len(self._paths)

    def read(self, index: int) -> Image:
        """Frame `index`."""
        path = self._paths[index]
        size, mode = self._look(path)  # before a pixel is decoded
        shape = (size[1], size[0]) + ((3,) if mode == "RGB" else ())
        if shape != self.shape or np.dtype(MODES[mode]) != self.dtype:
            raise FormatError(
                f"{path.name}: is {shape} {mode} where the first image is {self.shape} {self.dtype}"
            )
        image = self._open(path, mode)
        image.flags.writeable = False
        return image

    def _look(self, path: Path) -> tuple[tuple[int, int], str]:
        with self._guard(path), self._pillow.open(path) as image:
            mode = {"RGBA": "RGB", "P": "RGB", "I;16B": "I;16", "I": "I;16", "1": "L", "LA": "L"}.get(
                image.mode, image.mode
            )
            if mode not in MODES:
                raise UnsupportedError(
                    f"{path.name}: pixels of kind {image.mode} cannot be read; convert it to grey PNG"
                )
            return image.size, mode

    def _open(self, path: Path, mode: str) -> Image:
        with self._guard(path), self._pillow.open(path) as image:
            wanted = image if image.mode.startswith("I") or image.mode == mode else image.convert(mode)
            return np.asarray(wanted).astype(MODES[mode])

    def _guard(self, path: Path) -> _Guard:
        return _Guard(path)


class _Guard:
    """Turns Pillow's failures into sentences, and its size warning into a refusal."""

    def __init__(self, path: Path) -> None:
        self._path, self._warnings = path, warnings.catch_warnings()

    def __enter__(self) -> None:
        file_size(self._path)
        self._warnings.__enter__()
        warnings.simplefilter("ignore")

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        self._warnings.__exit__(kind, error, trace)
        if isinstance(error, Exception) and not isinstance(
            error, (FormatError, InputError, UnsupportedError)
        ):
            # Pillow's sentence would repeat the whole path.
            reason = "unknown kind" if "cannot identify" in str(error) else str(error)[:80]
            raise FormatError(f"{self._path.name}: is not an image that can be read ({reason})") from None


def _stamped(folder: Path, images: list[Path]) -> tuple[list[Path], Array, tuple[str, ...]]:
    """The images in the order of their times, the times, and the files read."""
    table = folder / STAMPS
    if table.is_file():
        times = _times_of_table(table, images)
        paths = [*images, table]
    else:
        times = np.array([_time_of_name(path) for path in images])
        paths = list(images)
    if np.isnan(times).any():
        return images, np.full(len(images), np.nan), tuple(map(str, paths))
    order = np.argsort(times, kind="stable")
    return [images[i] for i in order], times[order], tuple(map(str, paths))


def _times_of_table(path: Path, images: list[Path]) -> Array:
    table = parse_table(path.name, read_text(path, "a table of frame times"))
    column = table.first_of(TIME_COLUMNS)
    if column is None or "file" not in table.columns:
        raise InputError(
            f"{path.name}: needs the columns file and time_s; it has {', '.join(table.header)[:200]}"
        )
    stamps = dict(zip(table.text("file").tolist(), table.numbers(column), strict=True))
    if missing := [image.name for image in images if image.name not in stamps]:
        raise InputError(f"{path.name}: has no time for {missing[0]}; add a row, or delete the image")
    times = np.array([stamps[image.name] for image in images])
    if not np.isfinite(times).all():
        raise InputError(f"{path.name}: a time is not finite; write seconds")
    return times


def _time_of_name(path: Path) -> float:
    match = re.search(r"(\d{1,12}\.\d{1,9})$", path.stem)
    return float(match[1]) if match else float("nan")


def _natural(name: str) -> list[tuple[int, int, str]]:
    """frame2 before frame10."""
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"(\d+)", name)]


def _pillow(path: Path) -> Any:
    try:
        from PIL import Image as Pillow
    except ImportError:
        raise UnsupportedError(f"{path.name}: image files need Pillow; pip install 'sonocal[io]'") from None
    return Pillow
