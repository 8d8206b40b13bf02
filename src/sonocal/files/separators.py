"""What separates the cells of a table: a comma, a semicolon or a tab."""

from __future__ import annotations

import re
from collections.abc import Sequence

from sonocal.errors import FormatError

__all__ = ["is_comment", "other_width", "separator_of"]

QUOTED = re.compile(r'"[^"]*(?:"|$)')
DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
WORDS = {",": "comma", ";": "semicolon", "\t": "tab"}


# What Excel puts above a table, or is told there.
EXCEL_S = re.compile(r"\s*\"?sep=.\"?\s*", re.IGNORECASE)


def is_comment(line: str) -> bool:
    """Whether a line above a table's header is none of the table: a remark, or Excel's word on separators."""
    return line.lstrip().startswith("#") or EXCEL_S.fullmatch(line) is not None


def separator_of(text: str) -> str:
    """What separates the cells of a table: comma, semicolon or tab, by its first line that is not blank."""
    start = len(text) - len(text.lstrip())
    end = text.find("\n", start)
    line = QUOTED.sub("quoted", text[start:] if end < 0 else text[start:end])
    counts = {separator: line.count(separator) for separator in "\t;"}
    counts[","] = DECIMAL_COMMA.sub("", line).count(",")
    if not any("\t" in cell.strip() for cell in line.split(",")):
        counts["\t"] = 0  # blanks beside commas
    most = max(counts, key=counts.__getitem__)
    return most if counts[most] else ","


def other_width(where: str, row: Sequence[str], width: int, separator: str) -> FormatError:
    """What is wrong with a row that has not as many cells as the header."""
    line = separator.join(row)
    for other, word in WORDS.items():
        if other != separator and line.count(other) + 1 == width > 1:
            return FormatError(
                f"{where}: separates cells by {word}s where the header does by {WORDS[separator]}s; write one of the "
                "two all over"
            )
    has = f"{where}: has {len(row)} cells where the header has {width}"
    if (
        separator == ","
        and width < len(row) <= 2 * width
        and all(cell.lstrip(" -+").isdecimal() for cell in row)
    ):
        return FormatError(f"{has}; if its commas are decimal ones, separate cells by semicolons")
    if width == 1:
        return FormatError(f"{has}; delete the lines above the header, or begin them with #")
    return FormatError(f"{has}; quote cells that hold a {WORDS[separator]}")
