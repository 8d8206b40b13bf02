"""Files that the page sends: bounded, under a name that leads nowhere else."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from sonocal.errors import InputError
from sonocal.files import make_folder, write_atomically

__all__ = ["MOST_BYTES", "Uploads"]

MOST_BYTES = 512 << 20
"""Of all files of a session together; a longer recording is named on the command line, where nothing is copied."""
LONGEST_NAME = 120
FORBIDDEN = re.compile(r'[\x00-\x1f/\\:*?"<>|]')


class Uploads:
    """What was sent in this session, in a folder of its own."""

    def __init__(self, folder: Path, most_bytes: int = MOST_BYTES) -> None:
        """Begin; `folder` is made when the first file comes."""
        self._folder, self._most = folder, most_bytes
        self._sizes: dict[str, int] = {}
        self._known: dict[str, Path] = {}

    def know(self, path: Path) -> None:
        """A file that the command line named, which the page may ask for by its name."""
        self._known[path.name] = path

    async def take(self, name: str, length: str | None, parts: AsyncIterator[bytes]) -> str:
        """Write a file.

        Args:
            name: as the page gives it, percent-encoded.
            length: of the file, as the request says.
            parts: its content.

        Returns:
            Its name.

        Raises:
            InputError: the name is none, or the files are too large; nothing is kept then.
        """
        clean = file_name(name)
        left = self._most - sum(size for other, size in self._sizes.items() if other != clean)
        if length is not None and length.isdigit() and int(length) > left:
            raise self._too_large(clean)
        make_folder(self._folder)
        partly, size = self._folder / f".{clean}.part", 0
        try:
            with partly.open("wb") as file:
                async for part in parts:
                    size += len(part)
                    if size > left:
                        raise self._too_large(clean)
                    file.write(part)
            partly.replace(self._folder / clean)
        except OSError as error:
            raise InputError(
                f"{clean}: cannot be kept ({error.strerror}); make room in {self._folder}"
            ) from None
        finally:
            partly.unlink(missing_ok=True)
        self._sizes[clean] = size
        return clean

    def keep(self, name: str, content: bytes) -> Path:
        """Write a file of the studio's own, which the page may ask for by its name.

        Raises:
            InputError: the folder cannot be written.
        """
        make_folder(self._folder)
        write_atomically(self._folder / name, content)
        self._sizes[name] = len(content)
        return self._folder / name

    def path(self, name: Any) -> Path:
        """Where a file lies that was sent.

        Raises:
            InputError: none of that name was.
        """
        if isinstance(name, str) and name in self._sizes:
            return self._folder / name
        if not isinstance(name, str) or name not in self._known:
            raise InputError(f"{str(name)[:LONGEST_NAME]!r}: no such file was sent")
        return self._known[name]

    def _too_large(self, name: str) -> InputError:
        return InputError(
            f"{name}: is larger than the {self._most >> 20} MB that the page may send; start sonocal studio with its "
            "path instead: nothing is copied then"
        )


def file_name(given: str) -> str:
    """The name of a file that is to be kept.

    Raises:
        InputError: it is none, or leads elsewhere.
    """
    name = unquote(given)
    if not name.strip(". ") or len(name) > LONGEST_NAME or name.startswith(".") or FORBIDDEN.search(name):
        raise InputError(f"{name[:LONGEST_NAME]!r}: is no name for a file; rename it with letters and digits")
    return name
