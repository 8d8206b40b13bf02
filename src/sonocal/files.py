"""Reading and writing files: one sentence when it fails, nothing half written."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

from sonocal.errors import InputError

__all__ = ["read_bytes", "write_atomically", "write_into_folder"]


def read_bytes(path: str | Path, what: str) -> bytes:
    """The content of a file.

    Args:
        path: the file.
        what: what it should be, for the message, such as "the CSV file of observations".

    Raises:
        InputError: it cannot be read.
    """
    try:
        return Path(path).read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the name and the folder") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a directory; name {what} in it") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from None


def write_atomically(path: str | Path, content: bytes) -> None:
    """Write a file whole or not at all: into a temporary neighbour, then renamed over it.

    Raises:
        InputError: it cannot be written; what stood there before still stands.
    """
    path = Path(path)
    temporary = None
    try:
        if path.is_dir():
            raise IsADirectoryError(21, "it is a directory")
        descriptor, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        Path(temporary).chmod(0o666 & ~_umask())
        Path(temporary).replace(path)
    except OSError as error:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written ({error.strerror}); choose another place") from None


def write_into_folder(folder: str | Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder, which is made if it is absent.

    Raises:
        InputError: the folder cannot be made or a file cannot be written.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be made a folder ({error.strerror}); choose another place"
        ) from None
    for name, content in files.items():
        write_atomically(folder / name, content)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
