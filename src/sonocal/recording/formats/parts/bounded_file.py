"""Files that are never asked for more than they hold: damaged lengths would be allocated before they are read."""

from __future__ import annotations

import io
from pathlib import Path, PosixPath
from typing import Any

from sonocal.errors import FormatError
from sonocal.files import file_size, reading

__all__ = ["BoundedFile", "BoundedPath"]


class BoundedFile(io.BufferedReader):
    """A file to be read by a library that trusts the lengths in it.

    Attributes:
        allowance: bytes that may still be read, whatever is read twice; None where that has no end. An index whose
            entries name one place again and again would otherwise grow in memory far beyond its file.
    """

    def __init__(self, path: Path, allowance: int | None = None) -> None:
        self._path, self._size, self.allowance = path, file_size(path), allowance
        with reading(path):
            super().__init__(io.FileIO(path))

    def read(self, size: int | None = -1, /) -> bytes:
        """As of any file, but no more than is left."""
        left = max(self._size - self.tell(), 0)
        data = super().read(left if size is None or size < 0 else min(size, left))
        if self.allowance is not None:
            self.allowance -= len(data)
            if self.allowance < 0:
                raise FormatError(f"{self._path.name}: its index names the same places again and again")
        return data


class BoundedPath(PosixPath):
    """A path for a library that opens files itself: they are bounded."""

    def open(self, mode: str = "r", *args: Any, **how: Any) -> Any:
        """The file, bounded where it is read as bytes."""
        return BoundedFile(self) if mode == "rb" else super().open(mode, *args, **how)
