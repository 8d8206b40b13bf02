"""The image's size as it travels in a table: a comment line above the header, or columns."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from sonocal.errors import InputError
from sonocal.geometry import FURTHEST

__all__ = ["SIZE_COLUMNS", "checked_size", "size_in_words", "size_line", "size_of"]

SIZE_COLUMNS = ("image_width_px", "image_height_px", "image_depth_px")
SIZE_LINE = re.compile(r"#\s*image_size_px\s*[:=]\s*(.*)")


def checked_size(value: Any, dimension: int, what: str) -> tuple[int, ...]:
    """A size as whole numbers, one along each of the image's axes.

    Raises:
        InputError: it is none; the sentence begins with `what`.
    """
    try:
        numbers = [float(number) for number in value]
        size = tuple(int(number) for number in numbers)
    except (TypeError, ValueError, OverflowError):
        numbers, size = [], ()
    if len(size) != dimension or any(
        whole != number or not 1 <= whole < FURTHEST for whole, number in zip(size, numbers, strict=True)
    ):
        raise InputError(
            f"{what} must be {dimension} positive whole numbers below {FURTHEST:g} for a {dimension}D probe; "
            f"got {str(value)[:60]}"
        )
    return size


def size_in_words(size_px: Sequence[int]) -> str:
    """Such as "820 x 616"."""
    return " x ".join(map(str, size_px))


def size_line(size_px: Sequence[int] | None) -> str:
    """The comment line of a size; nothing where it is not known."""
    return "" if size_px is None else f"# image_size_px: {' '.join(map(str, size_px))}\n"


def size_of(
    name: str,
    comments: Sequence[tuple[int, str]],
    columns: Mapping[str, Sequence[str]],
    lines: Sequence[int],
    dimension: int,
) -> tuple[int, ...] | None:
    """The size that a table's comment lines and columns give, or None.

    Raises:
        InputError: one is no size, or two are not the same.
    """
    known: tuple[tuple[int, ...], str] | None = None
    for where, text in _stated(comments, columns, lines):
        size = checked_size(text.replace(",", " ").split(), dimension, f"{name}, {where}: the image's size")
        if known is not None and size != known[0]:
            raise InputError(
                f"{name}, {where}: says that images have {size_in_words(size)} px and {known[1]} "
                f"{size_in_words(known[0])}; a table is of images of one size"
            )
        known = known or (size, where)
    return None if known is None else known[0]


def _stated(
    comments: Sequence[tuple[int, str]], columns: Mapping[str, Sequence[str]], lines: Sequence[int]
) -> list[tuple[str, str]]:
    """Where a size is stated and what it says, each distinct one of the rows once."""
    stated = [
        (f"line {line}", found.group(1)) for line, text in comments if (found := SIZE_LINE.fullmatch(text))
    ]
    present = [columns[column] for column in SIZE_COLUMNS if column in columns]
    first: dict[str, int] = {}
    for line, cells in zip(lines, zip(*present, strict=True), strict=False):
        first.setdefault(" ".join(cell.strip() or "nothing" for cell in cells), line)
    return stated + [(f"line {line}", text) for text, line in first.items()]
