"""Files that a document names: beside it in a folder, or with it in a zip archive, of which nothing is believed."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from abc import abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from sonocal.errors import FormatError, InputError, SonocalError
from sonocal.files import beside, file_beside, file_size, read_text
from sonocal.recording.formats.parts.bounded_file import BoundedFile

__all__ = ["Archive", "Folder", "Home"]

TEXT_LIMIT = 16 << 20
FILE_LIMIT = 1 << 34
"""Largest file that is taken out of an archive, bytes."""
FREELY = 1 << 26
"""What is no larger is taken out however well it was compressed."""
EXPANSION = 200
"""How many times what it takes in the archive a larger one may have: images do not compress further."""
PIECE = 1 << 20


class Home:
    """Where a document and the files it names are.

    Attributes:
        name: of the archive or the document, for messages.
        document: the document's text.
        scratch: a folder of files taken out; None where there is none. Who keeps one of these has to remove it.
    """

    name: str
    document: str
    scratch: Path | None = None

    @abstractmethod
    def file(self, name: str) -> Path:
        """A file that the document names, as it stands or percent-encoded, with either slash between folders.

        Raises:
            FormatError: the name leads out of the document's folder, there is no such file, or it is absurdly large.
        """


class Folder(Home):
    """A document in a folder."""

    def __init__(self, path: Path, what: str) -> None:
        self.name, self._path = path.name, path
        self.document = read_text(path, what, TEXT_LIMIT)

    def file(self, name: str) -> Path:
        """As of `Home`."""
        for spelt in _spellings(name):
            if path := file_beside(self._path, spelt):
                return path
        raise FormatError(f"{self.name}: its file {name[:80]!r} is not beside it; copy all files together")


class Archive(Home):
    """A document in a zip archive; a file that it names is copied into a temporary folder when it is asked for.

    Args:
        path: of the archive.
        suffix: of the document, of which there is one.
        what: the document is, in words.

    Raises:
        FormatError: it is no archive, damaged, or without such a document.
    """

    def __init__(self, path: Path, suffix: str, what: str) -> None:
        self.name, self._path = path.name, path
        with self._opened() as archive:
            found = [one for one in archive.infolist() if _is_document(one.filename, suffix)]
            if len(found) != 1:
                raise InputError(f"{self.name}: has {len(found)} files {suffix} where {what} has one")
            self._document = PurePosixPath(_with_slashes(found[0].filename))
            self.document = self._text(archive, found[0], what)

    def file(self, name: str) -> Path:
        """As of `Home`: a copy, which lies in `scratch`."""
        with self._opened() as archive:
            there = {
                _with_slashes(one): info for one, info in archive.NameToInfo.items()
            } | archive.NameToInfo
            for spelt in _spellings(name):
                key = str(beside(Path(self._document), spelt).as_posix())
                if key in there:
                    return self._copied(archive, there[key])
        raise FormatError(f"{self.name}: its file {name[:80]!r} is not in it; save the scene again")

    @contextmanager
    def _opened(self) -> Iterator[zipfile.ZipFile]:
        file_size(self._path)
        try:
            with BoundedFile(self._path) as file, zipfile.ZipFile(file) as archive:
                yield archive
        except SonocalError:
            raise
        except Exception as error:  # zipfile raises many kinds for damaged archives
            raise FormatError(
                f"{self.name}: is a damaged zip archive ({str(error)[:80] or type(error).__name__}); copy it again"
            ) from None

    def _text(self, archive: zipfile.ZipFile, info: zipfile.ZipInfo, what: str) -> str:
        if info.file_size > TEXT_LIMIT:
            raise FormatError(
                f"{self.name}: {info.filename[:80]} states {info.file_size} bytes, more than {what} has"
            )
        try:
            return archive.read(info).decode("utf-8-sig")
        except UnicodeDecodeError:
            raise FormatError(f"{self.name}: {info.filename[:80]} is not UTF-8 text, as {what} is") from None

    def _copied(self, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Path:
        size, packed = info.file_size, info.compress_size
        if size > FILE_LIMIT or (size > FREELY and size > EXPANSION * packed):
            raise FormatError(
                f"{self.name}: {info.filename[:80]} states {size} bytes in {packed} compressed ones, as no images do; "
                "unpack it yourself if it is sound"
            )
        with self._on_disk():
            copy = self._place(size) / (PurePosixPath(_with_slashes(info.filename)).name[-100:] or "file")
            target = copy.open("wb")
        with target, archive.open(info) as source:
            # The archive's reader gives no more than the size that was looked at, and compares the checksum.
            while piece := source.read(PIECE):
                with self._on_disk():
                    target.write(piece)
        return copy

    def _place(self, size: int) -> Path:
        """A new folder for a file of a size."""
        if self.scratch is None:
            self.scratch = Path(tempfile.mkdtemp(prefix="sonocal-"))
        if size > shutil.disk_usage(self.scratch).free:
            raise InputError(
                f"{self.name}: {size} bytes are needed in {self.scratch.parent}; make room there"
            )
        return Path(tempfile.mkdtemp(dir=self.scratch))

    @contextmanager
    def _on_disk(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise InputError(
                f"{self.name}: cannot be unpacked to {tempfile.gettempdir()} ({error.strerror}); make room there"
            ) from None


def _is_document(name: str, suffix: str) -> bool:
    """Whether a file of an archive is a document; Macs put one ``._name`` of their own beside each file."""
    return name.lower().endswith(suffix) and not PurePosixPath(_with_slashes(name)).name.startswith("._")


def _with_slashes(name: str) -> str:
    """A name as archives have to have it; old programs of Windows write backslashes between folders."""
    return name.replace("\\", "/")


def _spellings(name: str) -> tuple[str, ...]:
    """What a document's name of a file may mean."""
    return name, unquote(name), _with_slashes(name), _with_slashes(unquote(name))
