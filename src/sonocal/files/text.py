"""Text files by their mark: UTF-8 with one or without, and UTF-16 with one, as spreadsheets save them."""

from __future__ import annotations

__all__ = ["decoded"]

MARKS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"))


def decoded(content: bytes, errors: str = "strict") -> str:
    """The text of a file without its mark.

    Args:
        content: the bytes; of UTF-8 where no mark says else.
        errors: as of `bytes.decode`: "replace" for the start of a file, which may end within a character.

    Raises:
        UnicodeDecodeError: it is no text.
    """
    for mark, encoding in MARKS:
        if content.startswith(mark):
            return content[len(mark) :].decode(encoding, errors)
    return content.decode("utf-8", errors)
