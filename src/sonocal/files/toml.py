"""TOML whose reading takes no longer than its size: parsers take the square of how deep a dotted key goes."""

from __future__ import annotations

import re
from pathlib import Path

from sonocal.errors import FormatError
from sonocal.files.disk import read_text

__all__ = ["read_toml_text"]

# Enough for a thousand wires; a line of a needle holds three numbers.
SIZE_LIMIT, LONGEST_LINE, MOST_PARTS = 256 << 10, 1000, 20
DEEP = re.compile(rf"(?:[^\s.,=\[\]{{}}]+\s*\.\s*){{{MOST_PARTS}}}")


def read_toml_text(path: Path, what: str) -> str:
    """The text of a TOML file.

    Args:
        path: the file.
        what: what messages say it should hold.

    Raises:
        InputError: it cannot be read or is too large.
        FormatError: it is not text, or a line is longer, or a key deeper, than anybody writes.
    """
    text = read_text(path, what, SIZE_LIMIT)
    for number, line in enumerate(text.splitlines(), 1):
        if len(line) > LONGEST_LINE:
            raise FormatError(
                f"{path.name}, line {number}: has {len(line)} characters, more than the {LONGEST_LINE} of any line of "
                f"{what}; is it the right file?"
            )
        if DEEP.search(line):
            raise FormatError(
                f"{path.name}, line {number}: a key has more than {MOST_PARTS} parts; is it the right file?"
            )
    return text
