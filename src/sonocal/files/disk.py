"""Bytes in and out of files, with every operating system failure turned into one sentence."""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import BinaryIO

from sonocal.errors import FormatError, InputError
from sonocal.files.text import decoded

TEXT_LIMIT = 64 << 20
"""Largest text file (CSV, XML, TOML) read in one piece, bytes: hours of poses fit in it."""
BYTES_LIMIT = 512 << 20
"""Largest table of sightings or calibration read in one piece, bytes: four million rows fit in it."""


def path_of(name: str | os.PathLike[str]) -> Path:
    """The path that somebody names a file or folder by.

    Raises:
        InputError: it is no text, or none that a file could be called.
    """
    if not isinstance(name, (str, os.PathLike)) or not isinstance(text := os.fspath(name), str):
        raise InputError(f"path must be the name of a file, as text or a Path; got {name!r}"[:200])
    try:
        os.fsencode(text)
    except UnicodeEncodeError:
        raise InputError(f"{text!r}: no file can be called so, it holds half a character"[:200]) from None
    if "\0" in text:
        raise InputError(f"{text!r}: no file can be called so, it holds a zero byte"[:200])
    return Path(text)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn the failures of reading a file into an `InputError`; what is no file, and could keep one waiting, is one."""
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise InputError(f"{path}: is a pipe or a device; write what comes from it to a file first")
        yield
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the name and the folder") from None
    except OSError as error:
        if _opened_a_folder(path, error):
            raise InputError(f"{path}: is a directory; name the file in it") from None
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from None


def _opened_a_folder(path: Path, error: OSError) -> bool:
    """Windows refuses a folder's opening as it does a file's without permission."""
    if isinstance(error, PermissionError):
        return path.is_dir() and os.access(path, os.R_OK)
    return isinstance(error, IsADirectoryError)


def digest(path: Path) -> str:
    """The SHA-256 of a file; of a folder, of what its files hold, in the order of their names."""
    whole = hashlib.sha256()
    with reading(path):
        for part in sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]:
            with part.open("rb") as file:
                while piece := file.read(1 << 20):
                    whole.update(piece)
    return whole.hexdigest()


def file_size(path: Path) -> int:
    """The size of a file in bytes."""
    with reading(path):
        return path.stat().st_size


def read_at(path: Path, offset: int, count: int) -> bytes:
    """Up to `count` bytes from `offset`; the file is open no longer than that."""
    with reading(path), path.open("rb", buffering=0) as file:
        file.seek(offset)
        pieces = []
        while count > 0 and (piece := file.read(count)):
            pieces.append(piece)
            count -= len(piece)
        return pieces[0] if len(pieces) == 1 else b"".join(pieces)


def read_text(path: Path, what: str, limit: int = TEXT_LIMIT) -> str:
    """The text of a file: UTF-8, or what its mark says.

    Raises:
        InputError: it cannot be read, or is larger than `limit`.
        FormatError: it is not text.
    """
    size = file_size(path)
    if size > limit:
        raise InputError(
            f"{path.name}: holds {size} bytes, more than the {limit} of {what}; is it the right file?"
        )
    try:
        text = decoded(read_at(path, 0, size))
    except UnicodeDecodeError as error:
        encoding = error.encoding.upper()
        raise FormatError(
            f"{path.name}: byte {error.start} is not {encoding}; {what} is UTF-8 text"
        ) from None
    if "\0" in text:
        looks = (
            ", as UTF-16 without its mark does: save it as UTF-8" if text.count("\0") > len(text) / 3 else ""
        )
        raise FormatError(f"{path.name}: holds a zero byte{looks}; {what} is UTF-8 text")
    return text


def beside(header: Path, name: str) -> Path:
    """The data file that a header names, which must lie in the header's folder.

    Raises:
        FormatError: the name is absolute or climbs out: a header from elsewhere could then name any
            file of this machine.
    """
    posix, windows = PurePosixPath(name), PureWindowsPath(name)
    if posix.is_absolute() or windows.drive or windows.root or ".." in windows.parts or "\0" in name:
        raise FormatError(
            f"{header.name}: its data file {name!r} lies outside the header's folder; "
            "move it beside the header and name it there"
        )
    return header.parent / name


def file_beside(header: Path, name: str) -> Path | None:
    """The data file that a header names; None where there is none. Raises as `beside`."""
    path = beside(header, name)
    try:
        return path if path.is_file() else None
    except OSError:  # longer than a name of a file can be
        return None


def refuse_device(path: Path) -> None:
    """Refuse to write where a pipe or a device is: the file would take its place, /dev/null's even, for everybody.

    Raises:
        InputError: there is one.
    """
    with suppress(OSError):  # which the writing itself will say
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise InputError(f"{path}: is a pipe or a device; choose another place")


@contextmanager
def writing(path: str | Path) -> Iterator[BinaryIO]:
    """A file that appears under its name only when all of it is written; a pipe or a device is none."""
    path = path_of(path)
    refuse_device(path)
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:40]}.")
        with os.fdopen(handle, "w+b") as file:
            yield file
        # mkstemp makes a file only its owner reads; a result has the rights any new file would have.
        Path(temporary).chmod(0o666 & ~_umask())
        Path(temporary).replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); {_remedy(path, error)}") from None
    finally:
        if temporary is not None:
            with suppress(OSError):
                Path(temporary).unlink()


def read_bytes(path: str | Path) -> bytes:
    """The content of a file.

    Raises:
        InputError: it cannot be read, or is larger than `BYTES_LIMIT`.
    """
    path = path_of(path)
    if (size := file_size(path)) > BYTES_LIMIT:
        raise InputError(
            f"{path.name}: holds {size} bytes, and more than {BYTES_LIMIT} are no table; is it the right file?"
        )
    with reading(path):
        return path.read_bytes()


def write_atomically(path: str | Path, content: bytes) -> None:
    """Write a file whole or not at all: into a temporary neighbour, then renamed over it.

    Raises:
        InputError: it cannot be written; what stood there before still stands.
    """
    with writing(path) as file:
        file.write(content)


def write_into_folder(folder: str | Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder, which is made if it is absent: none appears before all of them are on the disk.

    Raises:
        InputError: the folder cannot be made or a file cannot be written.
    """
    make_folder(folder)
    with ExitStack() as stack:
        for name, content in files.items():
            file = stack.enter_context(writing(Path(folder) / name))
            file.write(content)
            file.flush()


def make_folder(folder: str | Path) -> None:
    """Make a folder, and those above it, if it is absent.

    Raises:
        InputError: it cannot be made.
    """
    try:
        path_of(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be made a folder ({error.strerror}); choose another place"
        ) from None


def remove(path: Path) -> None:
    """Remove a file.

    Raises:
        InputError: it cannot be removed.
    """
    try:
        path.unlink()
    except OSError as error:
        raise InputError(f"{path}: cannot be replaced ({error.strerror}); {_remedy(path, error)}") from None


def _remedy(path: Path, error: OSError) -> str:
    """Windows replaces no file that another program has open, a table in Excel say."""
    mine = path.is_file() and os.access(path.parent, os.W_OK)
    if isinstance(error, PermissionError) and mine:
        return "close it where it is open, or choose another place"
    return "choose another place"


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
