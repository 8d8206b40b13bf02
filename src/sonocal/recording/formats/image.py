"""Single images (``.png``, ``.tif``, ...): a recording of one frame; the frames of folders, too."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sonocal.errors import FormatError
from sonocal.files import file_size
from sonocal.files.kinds import Format, Head
from sonocal.geometry import Array
from sonocal.recording.formats.parts.pictures import Pictures
from sonocal.recording.frames import Frames, Image
from sonocal.recording.model import ImageGeometry, Provenance, Recording

__all__ = ["FORMAT", "SUFFIXES", "read_image", "recording_of_images"]

SUFFIXES = (".png", ".bmp", ".tif", ".tiff", ".jpg", ".jpeg")
STARTS = (b"\x89PNG", b"\xff\xd8\xff", b"II*\0", b"MM\0*")


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
    """Frames in files of their own."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths, self._pictures = paths, Pictures(paths[0], "image files need Pillow")
        file_size(paths[0])
        kind = self._pictures.look(paths[0], paths[0].name)
        self.shape, self.dtype = kind.shape, kind.dtype

    def __len__(self) -> int:
        return len(self._paths)

    def read(self, index: int) -> Image:
        """Frame `index`."""
        path = self._paths[index]
        file_size(path)
        kind = self._pictures.look(path, path.name)  # before a pixel is decoded
        if kind.shape != self.shape or kind.dtype != self.dtype:
            raise FormatError(
                f"{path.name}: is {kind.shape} {kind.mode} where the first image is {self.shape} {self.dtype}"
            )
        image = self._pictures.decode(path, path.name, kind)
        image.flags.writeable = False
        return image


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
