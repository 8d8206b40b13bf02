"""What a format says of itself, and which of several formats a file is in, by what is in it.

A room that reads files lists its formats (`sonocal.recording.formats.registry`, `sonocal.targets.formats`,
`sonocal.existing.formats`); the command line joins the lists. Nothing heavy is imported until a file is read.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from sonocal.errors import UnsupportedError
from sonocal.files.disk import read_at
from sonocal.files.hdf5 import MAGIC, names_in
from sonocal.files.separators import is_comment, separator_of, without_frame
from sonocal.files.tables import is_number
from sonocal.files.text import decoded

__all__ = ["TABLE_SUFFIXES", "Format", "Head", "Kind", "recognise", "refuse_container", "suffixes_of"]

Kind = Literal[
    "calibration", "checks", "device set", "known points", "matrix", "observations", "page", "points", "recording",
    "study", "targets", "truth"
]  # fmt: skip

HEAD_BYTES = 4096
# Names of files that are packed by nature: theirs say what they are.
HDF5_SUFFIXES = (".h5", ".hdf5")
PACKED = (*HDF5_SUFFIXES, ".mrb", ".npz")
# What files start with that are often given under the name of what was put into them.
CONTAINERS = (
    (b"\x1f\x8b", "compressed (gzip); unpack it first"),
    (b"BZh", "compressed (bzip2); unpack it first"),
    (b"\xfd7zXZ", "compressed (xz); unpack it first"),
    (b"7z\xbc\xaf", "an archive (7z); unpack it first"),
    (b"PK\x03\x04", "an Excel workbook (.xlsx) or another zip archive; save the sheet as CSV, or unpack it"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook (.xls); save the sheet as CSV"),
    (MAGIC, "an HDF5 file, whatever its name says; export it as text"),
)
TABLE_SUFFIXES = (".csv", ".txt")


@dataclass(frozen=True)
class Head:
    """The start of a file, read once, and what formats are known by.

    Attributes:
        path: of the file, or of a folder.
        content: its first bytes; none of a folder.
    """

    path: Path
    content: bytes

    @classmethod
    def of(cls, path: Path) -> Head:
        """Read the start of a file.

        Raises:
            InputError: it cannot be read.
        """
        return cls(path, b"" if path.is_dir() else read_at(path, 0, HEAD_BYTES))

    @property
    def suffix(self) -> str:
        """The end of the name, in small letters: ``.mha`` of ``Sweep.igs.MHA``."""
        return self.path.suffix.lower()

    @cached_property
    def text(self) -> bytes:
        """The content without a byte order mark and blanks before it; as UTF-8 where the mark is of another."""
        if self.content.startswith((b"\xff\xfe", b"\xfe\xff")):
            return decoded(self.content, "replace").encode("utf-8", "replace").lstrip()
        return self.content.removeprefix(b"\xef\xbb\xbf").lstrip()

    @cached_property
    def header_line(self) -> str:
        """The first line that is no comment."""
        rows = (row.decode("utf-8", "replace") for row in self.text.splitlines() if row.strip())
        return next((row for row in rows if not is_comment(row)), "")

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The cells of a CSV table's header: the first line that is no comment; none where that is no text."""
        if b"\0" in self.text:
            return ()
        line, separator = self.header_line, separator_of(self.header_line)
        try:
            cells = next(
                csv.reader([without_frame(line) if separator == "|" else line], delimiter=separator), []
            )
        except csv.Error:
            return ()
        return tuple(cell.strip() for cell in cells)

    @cached_property
    def hdf5_names(self) -> frozenset[str]:
        """What an HDF5 file holds, by name; nothing of another file, or of a damaged one."""
        return names_in(self.path) if self.content.startswith(MAGIC) and self.path.is_file() else frozenset()

    @property
    def words(self) -> tuple[str, ...]:
        """The cells of the first line that is no comment, or its words where nothing but blanks separates them."""
        return (
            self.columns if len(self.columns) > 1 or b"\0" in self.text else tuple(self.header_line.split())
        )

    @property
    def lacks_header(self) -> bool:
        """Whether the first line that is no comment is two numbers or more, where a table has the names of columns."""
        cells = [cell.replace(",", ".") for cell in self.words if cell]
        return len(cells) > 1 and all(map(is_number, cells))

    @property
    def is_page(self) -> bool:
        """Whether it is a web page: what a browser saves where a download was refused."""
        return self.text[:14].lower().startswith((b"<!doctype html", b"<html"))

    @property
    def container(self) -> str:
        """What other program's packing the file is, with what to do, whatever its name says; empty where it is none."""
        return next((words for start, words in CONTAINERS if self.content.startswith(start)), "")

    @property
    def looks_like(self) -> str:
        """What a file is, in words for a message, where no format claims it."""
        if self.is_page:
            return "a web page (HTML), whatever its name says,"
        if not self.content.strip():
            return "an empty file"
        if b"\0" in self.text:
            return "binary data"
        return "XML" if self.text.startswith(b"<") else "text"


@dataclass(frozen=True)
class Format:
    """One format of files: the whole of what the rest of the package must know of it.

    Attributes:
        name: as people call it.
        kind: what is in such a file.
        suffixes: how names of such files end, in small letters; none of folders.
        sniff: whether a file that starts so is one. Sound files are claimed by one format alone.
        read: reads a file, and raises a `SonocalError` of one sentence where it cannot.
        holds: what of the format is read, in a line for the documentation.
        write: ``write(value, path)`` writes what `read` gives; recordings are told whether to compress, too.
            None of formats that are only read.
        writes: which of the suffixes may be written.
        needs: packages to install for it.
        header: of tables, what their first line is known by, in words.
        options: keywords of what only its user knows, such as the order of angles, that `read` takes.
    """

    name: str
    kind: Kind
    suffixes: tuple[str, ...]
    sniff: Callable[[Head], bool]
    read: Callable[..., Any]
    holds: str
    write: Callable[..., None] | None = None
    writes: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    header: str = ""
    options: tuple[str, ...] = ()


def refuse_container(head: Head) -> None:
    """Raise if a file that no format claims is another program's packing, whatever its name says.

    Raises:
        UnsupportedError: it is.
    """
    if head.content.startswith(MAGIC) and head.suffix in HDF5_SUFFIXES:
        there = ", ".join(sorted(head.hdf5_names))[:120] or "nothing that can be read"
        raise UnsupportedError(
            f"{head.path.name}: is HDF5 that holds {there}; what is read of it are transforms of ITK and 3D Slicer "
            "(TransformGroup) and scans of TUS-REC (frames, tforms)"
        )
    if head.container:
        raise UnsupportedError(f"{head.path.name}: is {head.container}")


def recognise(head: Head, formats: Iterable[Format]) -> Format | None:
    """The format that a file is in: by what is in it, or else by its name, since damaged files keep theirs.

    A name counts where all formats that share its suffix are of one kind: ``.csv`` alone says nothing of a
    table among tables of several kinds.
    """
    formats = tuple(one for one in formats if not head.is_page or one.kind == "page")
    if claimed := next((one for one in formats if one.sniff(head)), None):
        return claimed
    if head.is_page or (head.container and head.suffix not in PACKED):
        return None
    named = [one for one in formats if head.suffix in one.suffixes]
    return named[0] if len({one.kind for one in named}) == 1 else None


def suffixes_of(formats: Iterable[Format]) -> str:
    """The suffixes of formats, each once, for a message."""
    return ", ".join(dict.fromkeys(suffix for one in formats for suffix in one.suffixes))
