"""A 4 x 4 matrix in plain text: 16 numbers row by row, with blanks, commas, semicolons or brackets around them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from sonocal.errors import FormatError
from sonocal.existing.matrix import LAST_ROW, ROUNDING, Matrices, checked
from sonocal.files import read_text
from sonocal.files.kinds import TABLE_SUFFIXES, Format, Head
from sonocal.geometry import Array

__all__ = ["FORMAT", "read_plain_text"]

SIZE_LIMIT = 64 << 10
COUNT = 16
REMARK = re.compile(r"(#|%|//).*")
# ``ImageToProbe = [...]``, ``A = np.array([...])``, ``"probe_from_image": [[...]]``.
NAMED = re.compile(r"\s*[\"']?([A-Za-z_][\w.]{0,80})[\"']?\s*[=:]\s*")
CALL = re.compile(r"\b(?:[a-z]{1,8}\.)?(?:array|matrix|Matrix)\s*\(", re.ASCII)
BETWEEN = re.compile(r"[\[\](){},;|\s]+")
DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")


def read_plain_text(path: Path) -> Matrices:
    """The matrix in a file of text.

    Raises:
        FormatError: it has no 16 numbers, or these are no matrix from px to mm.
        InputError: the matrix cannot be inverted.
    """
    text = read_text(path, "a 4 x 4 matrix", SIZE_LIMIT)
    name, words = _words(text)
    if len(words) != COUNT:
        raise FormatError(
            f"{path.name}: a matrix from px to mm has 16 numbers, 4 rows of 4; got {_counted(words)}; give these alone"
        )
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        wrong = next(word for word in words if not _is_number(word))
        raise FormatError(f"{path.name}: {wrong[:40]!r} is no number; write 4 rows of 4 numbers") from None
    return Matrices(path.name, FORMAT.name, (checked(path.name, numbers.reshape(4, 4), name),))


def _words(text: str) -> tuple[str, list[str]]:
    """The name before the numbers, if there is one, and what stands between blanks and brackets."""
    lines = [REMARK.sub("", line) for line in text.splitlines()]
    whole = CALL.sub(" ", "\n".join(lines))
    named = NAMED.match(whole)
    body = whole[named.end() :] if named else whole
    words = [word for word in BETWEEN.split(body) if word]
    if len(words) > COUNT and "." not in body:
        # 16 cells, of which a comma parts in two each that is no whole number.
        cells = [word for word in BETWEEN.split(DECIMAL_COMMA.sub(".", body)) if word]
        words = cells if len(cells) == COUNT else words
    return named[1] if named else "", words


def _counted(words: list[str]) -> str:
    return f"{len(words)} words" if any(not _is_number(word) for word in words) else f"{len(words)} numbers"


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _sniff(head: Head) -> bool:
    """Whether all of it is a matrix whose last row or column is 0 0 0 1: other tables have headers, or no such row."""
    if b"\0" in head.content or len(head.content) >= SNIFFED:
        return False
    try:
        words = _words(head.text.decode("utf-8"))[1]
        matrix: Array = np.array([float(word) for word in words])
    except (UnicodeDecodeError, ValueError):
        return False
    if len(matrix) != COUNT:
        return False
    ends = (matrix[12:], matrix[3::4])
    return any(bool(np.all(np.abs(end - LAST_ROW) <= ROUNDING)) for end in ends)


# What a head holds: longer files are not seen whole.
SNIFFED = 4096

FORMAT = Format(
    name="4 x 4 matrix as text",
    kind="matrix",
    suffixes=TABLE_SUFFIXES,
    sniff=_sniff,
    read=read_plain_text,
    holds="16 numbers row by row, with blanks, commas or brackets; transposed ones are turned back",
)
