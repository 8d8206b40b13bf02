"""The lines of a header before pixels, by the thousand: one at a time they cost an hour of poses half a second more."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from sonocal.errors import FormatError

__all__ = ["HeaderLines"]

CHUNK = 1 << 20


@dataclass(frozen=True)
class HeaderLines:
    """How the header of a format ends.

    Attributes:
        end: its last line, with the line's end.
        word: stands in that line; looked for first, as that is fast.
        longest: bytes of a line; longer ones are pixels taken for text.
        kind: such as "a MetaIO header".
        closing: how it ends, in words: "ends with ElementDataFile".
    """

    end: re.Pattern[bytes]
    word: bytes
    longest: int
    kind: str
    closing: str

    def blocks(self, name: str, file: BinaryIO, number: int = 1) -> Iterator[tuple[int, list[str], int]]:
        """Blocks of lines from where a file stands: the number of the first line, the lines, the offset behind them.

        The last block holds the last line of the header, or of the file.

        Args:
            name: of the file, for messages.
            file: to read from.
            number: of the line that comes next.

        Raises:
            FormatError: a line is not text.
        """
        offset, rest = file.tell(), b""
        while True:
            chunk = file.read(CHUNK)
            block = rest + chunk
            whole = block.rfind(b"\n") + 1 if len(chunk) == CHUNK else len(block)
            end = self.end.search(block, 0, whole) if self.word in block else None
            whole = end.end() if end else whole
            if len(block) - whole >= self.longest and not end:
                raise self._no_text(name, number + block.count(b"\n", 0, whole))
            text = self._text(name, number, block[:whole])
            offset += whole
            yield number, text.removesuffix("\n").split("\n") if text else [], offset
            if end or len(chunk) < CHUNK:
                return
            number, rest = number + text.count("\n"), block[whole:]

    def _text(self, name: str, number: int, block: bytes) -> str:
        if (zero := block.find(b"\0")) >= 0:
            raise self._no_text(name, number + block.count(b"\n", 0, zero))
        try:
            return block.decode("utf-8")
        except UnicodeDecodeError as error:
            line = number + block.count(b"\n", 0, error.start)
            raise FormatError(f"{name}, line {line}: is not UTF-8 text; {self.kind} is") from None

    def _no_text(self, name: str, line: int) -> FormatError:
        return FormatError(f"{name}, line {line}: is not text; {self.kind} {self.closing}")
