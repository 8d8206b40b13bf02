"""Single images (``.png``, ``.tif``, ...): a recording of one frame; the frames of folders, too."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, InputError, UnsupportedError
from sonocal.files import file_size
from sonocal.files.kinds import Format, Head
from sonocal.geometry import Array
from sonocal.recording.formats.parts.packages import needed
from sonocal.recording.frames import PICTURE_LIMIT, Frames, Image, check_frame_size
from sonocal.recording.model import ImageGeometry, Provenance, Recording

__all__ = ["FORMAT", "SUFFIXES", "read_image", "recording_of_images"]

SUFFIXES = (".png", ".bmp", ".tif", ".tiff", ".jpg", ".jpeg")
STARTS = (b"\x89PNG", b"\xff\xd8\xff", b"II*\0", b"MM\0*")
MODES = {"L": "u1", "RGB": "u1", "I;16": "u2", "F": "f4"}


def read_image(path: Path) -> Recording:
    """Read a single image: a recording of one frame without time or poses.

    Raises:
        FormatError: the file is no image.
        UnsupportedError: Pillow is not installed.
    """
    return recording_of_images([path], np.array([np.nan]), Provenance(path.name, "image", (str(path),)))


def recording_of_images(images: Sequence[Path], times: Array, provenance: Provenance) -> Recording:
    """A recording whose frames are files of their own, (N,) times in s."""
    frames = ImageFiles(images)
    return Recording(times=times, frames=frames, image=ImageGeometry.of(frames), provenance=provenance)


class ImageFiles(Frames):
    """Frames in files of their own, decoded by Pillow."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths, self._pillow = (
            paths,
            needed("PIL.Image", paths[0], "image files need Pillow"),
        )
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


def _sniff(head: Head) -> bool:
    start = head.content
    return start.startswith(STARTS) or (start.startswith(b"BM") and b"\0" in start)


FORMAT = Format(
    name="image",
    kind="recording",
    suffixes=SUFFIXES,
    sniff=_sniff,
    read=read_image,
    holds="8 and 16 bit, float, colour; one frame without time",
    needs=("pillow",),
)
