"""Pictures (PNG, JPEG, TIFF, ...), in files or in messages, by Pillow."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, SonocalError, UnsupportedError
from sonocal.recording.formats.parts.packages import needed
from sonocal.recording.frames import PICTURE_LIMIT, Image, check_frame_size

__all__ = ["Pictures"]

MODES = {"L": "u1", "RGB": "u1", "I;16": "u2", "F": "f4"}
READ_AS = {"RGBA": "RGB", "P": "RGB", "I;16B": "I;16", "I": "I;16", "1": "L", "LA": "L"}


@dataclass(frozen=True)
class Kind:
    """What a picture says of itself.

    Attributes:
        shape: (rows, columns[, 3]).
        mode: Pillow's name of what it is read as.
    """

    shape: tuple[int, ...]
    mode: str

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the pixels."""
        return np.dtype(MODES[self.mode])


class Pictures:
    """A decoder of pictures.

    Args:
        path: of the file that needs it, for the message.
        sentence: what needs Pillow, such as "image files need Pillow".

    Raises:
        UnsupportedError: Pillow is not installed.
    """

    def __init__(self, path: Path, sentence: str) -> None:
        self._pillow = needed("PIL.Image", path, sentence, "pillow")

    def look(self, source: Path | bytes, name: str) -> Kind:
        """What a picture is, before a pixel is decoded.

        Raises:
            FormatError: it is none.
            UnsupportedError: its pixels are of a kind that is not read, or too many.
        """
        with self._opened(source, name) as picture:
            mode = READ_AS.get(picture.mode, picture.mode)
            if mode not in MODES:
                raise UnsupportedError(
                    f"{name}: pixels of kind {picture.mode} cannot be read; convert it to grey PNG"
                )
            width, height = picture.size
        kind = Kind((height, width) + ((3,) if mode == "RGB" else ()), mode)
        check_frame_size(name, kind.shape, kind.dtype, PICTURE_LIMIT)
        return kind

    def decode(self, source: Path | bytes, name: str, kind: Kind) -> Image:
        """The pixels of a picture that `look` was taken at."""
        with self._opened(source, name) as picture:
            wanted = (
                picture if picture.mode[0] == "I" or picture.mode == kind.mode else picture.convert(kind.mode)
            )
            return np.asarray(wanted).astype(kind.dtype)

    @contextmanager
    def _opened(self, source: Path | bytes, name: str) -> Iterator[Any]:
        """An open picture; Pillow's failures become sentences, and its warning of sizes a refusal of ours."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                with self._pillow.open(
                    io.BytesIO(source) if isinstance(source, bytes) else source
                ) as picture:
                    yield picture
            except SonocalError:
                raise
            except Exception as error:  # Pillow raises many kinds for damaged pictures
                # Its sentence would repeat the whole path.
                reason = "unknown kind" if "cannot identify" in str(error) else str(error)[:80]
                raise FormatError(f"{name}: is not an image that can be read ({reason})") from None
