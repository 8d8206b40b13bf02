"""What separates the cells of a table: a comma, a semicolon, a tab, or the bars of a table that was printed."""

from __future__ import annotations

import re
from collections.abc import Sequence

from sonocal.errors import FormatError, InputError

__all__ = ["decimal_points", "is_comment", "other_width", "separator_of", "without_frame"]

QUOTED = re.compile(r'"[^"]*(?:"|$)')
DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
WORDS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar"}
# Of a number that was cut in two at its comma, either part; or a blank cell.
PART = re.compile(r"(?:[-+]?\d+(?:[eE][-+]?\d+)?)?")
# Below a header in Markdown, and around tables that databases print, with what these say of them at the end.
RULE = re.compile(r"(?=.*--)[\s|+:-]+")
ROWS_COUNTED = re.compile(r"\s*\(\d+ rows?\)\s*")


# What Excel puts above a table, or is told there.
EXCEL_S = re.compile(r"\s*\"?sep=.\"?\s*", re.IGNORECASE)


def is_comment(line: str) -> bool:
    """Whether a line above a table's header is none of the table: a remark, Excel's word on separators, a frame."""
    return line.lstrip().startswith("#") or any(one.fullmatch(line) for one in (EXCEL_S, RULE))


def separator_of(text: str) -> str:
    """What separates the cells of a table: comma, semicolon, tab or bar, by its first line that is not blank."""
    start = len(text) - len(text.lstrip())
    end = text.find("\n", start)
    line = QUOTED.sub("quoted", text[start:] if end < 0 else text[start:end])
    counts = {separator: line.count(separator) for separator in "\t;"}
    counts[","] = DECIMAL_COMMA.sub("", line).count(",")
    counts["|"] = line.count("|")
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
        and all(PART.fullmatch(cell.strip()) for cell in row)
    ):
        return FormatError(f"{has}; if its commas are decimal ones, separate cells by semicolons")
    if width == 1:
        return FormatError(f"{has}; delete the lines above the header, or begin them with #")
    return FormatError(f"{has}; quote cells that hold a {WORDS[separator]}")


def without_frame(text: str) -> str:
    """A table of bars, as people and databases print it, with nothing but its cells and one bar between two.

    Lines keep their numbers, so that messages name the file's own.
    """
    rows = text.split("\n")
    header = next((row.strip() for row in rows if row.strip() and not RULE.fullmatch(row)), "")
    framed = header.startswith("|") and header.endswith("|")
    for i, row in enumerate(rows):
        if RULE.fullmatch(row) or ROWS_COUNTED.fullmatch(row):
            rows[i] = ""
            continue
        line = row.strip()
        if framed:
            line = line.removeprefix("|").removesuffix("|")
        rows[i] = "|".join(map(str.strip, line.split("|")))
    return "\n".join(rows)


def decimal_points(where: str, cells: Sequence[str]) -> list[str]:
    """The cells of a column of numbers, each with a point for its decimal comma.

    Raises:
        InputError: others have decimal points, so that a comma may part thousands.
    """
    if not any("," in cell for cell in cells):
        return [*cells]
    if pointed := next((cell for cell in cells if "." in cell), None):
        raise InputError(
            f"{where}: {pointed.strip()[:40]!r} has a decimal point where others of its numbers have commas; write one "
            "of the two all over"
        )
    return [cell.replace(",", ".") if cell.count(",") == 1 else cell for cell in cells]
