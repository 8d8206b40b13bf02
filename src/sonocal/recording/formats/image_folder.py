"""Folders of images (PNG, ... or DICOM), and how their frames are stamped.

Times come from ``frames.csv`` in the folder (columns ``file`` and a time such as ``time_s``), or from the
files' names where each ends with decimal seconds (``frame_12.345.png``). Without either there are none.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from sonocal.errors import InputError
from sonocal.files import read_text, reading
from sonocal.files.elsewhere import is_study
from sonocal.files.kinds import Format
from sonocal.files.tables import parse_table
from sonocal.geometry import Array
from sonocal.recording.formats.dicom import SUFFIXES as DICOM_SUFFIXES
from sonocal.recording.formats.dicom import read_dicom_files
from sonocal.recording.formats.image import SUFFIXES as IMAGE_SUFFIXES
from sonocal.recording.formats.image import recording_of_images
from sonocal.recording.formats.parts.stamps import time_column, times_of
from sonocal.recording.formats.rosbag import is_bag_folder
from sonocal.recording.model import Provenance, Recording

__all__ = ["FORMAT", "STAMPS", "images_in", "read_image_folder"]

STAMPS = "frames.csv"


def read_image_folder(folder: Path) -> Recording:
    """Read a folder of images.

    Raises:
        InputError: there are none, or ``frames.csv`` does not fit them.
        FormatError: a file is no image, or differs in size.
        UnsupportedError: Pillow or pydicom is not installed.
    """
    name = folder.resolve().name
    images, dicoms = images_in(folder)
    if not images and not dicoms:
        raise InputError(f"{name}: holds no image files ({', '.join(IMAGE_SUFFIXES + DICOM_SUFFIXES)})")
    if images and dicoms:
        raise InputError(f"{name}: holds both DICOM files and other images; keep one kind in it")
    if dicoms:
        return read_dicom_files(dicoms, name)
    images, times, paths = _stamped(folder, images)
    return recording_of_images(images, times, Provenance(name, "images", paths))


def images_in(folder: Path) -> tuple[list[Path], list[Path]]:
    """The images of a folder, and its DICOM files, in the order of their names.

    Raises:
        InputError: the folder cannot be read.
    """
    with reading(folder):
        entries = sorted(folder.iterdir(), key=lambda p: _natural(p.name))
    images = [p for p in entries if p.suffix.lower() in IMAGE_SUFFIXES and p.is_file()]
    return images, [p for p in entries if p.suffix.lower() in DICOM_SUFFIXES and p.is_file()]


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
    if time_column(table.header) is None or "file" not in table.columns:
        raise InputError(
            f"{path.name}: needs the columns file and time_s; it has {', '.join(table.header)[:200]}"
        )
    stamps = dict(zip(table.text("file").tolist(), times_of(table)[0], strict=True))
    if missing := [image.name for image in images if image.name not in stamps]:
        raise InputError(f"{path.name}: has no time for {missing[0]}; add a row, or delete the image")
    return np.array([stamps[image.name] for image in images])


def _time_of_name(path: Path) -> float:
    match = re.search(r"(\d{1,12}\.\d{1,9})$", path.stem)
    return float(match[1]) if match else float("nan")


def _natural(name: str) -> list[tuple[int, int, str]]:
    """frame2 before frame10."""
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"(\d+)", name)]


FORMAT = Format(
    name="folder of images or of DICOM files",
    kind="recording",
    suffixes=(),
    sniff=lambda head: head.path.is_dir() and not is_bag_folder(head.path) and not is_study(head),
    read=read_image_folder,
    holds="with the one table of poses in it; stamps from `frames.csv`, names or DICOM's times",
    needs=("pillow", "pydicom"),
)
