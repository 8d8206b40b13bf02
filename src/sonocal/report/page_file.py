"""What a page says of itself to programs: the verdict and the matrix, in its head."""

from __future__ import annotations

from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from sonocal.errors import FormatError
from sonocal.files import read_at
from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = ["Page", "page_summary", "read_page"]

# The name of the element of the head, and how far into a page it is looked for.
NAME, WITHIN = "sonocal-summary", 64 << 10


@dataclass(frozen=True, eq=False)
class Page:
    """A page that sonocal wrote.

    Attributes:
        name: of the file.
        title: of the page.
        made: when, and by which sonocal; "" where it does not say.
        source: what was calibrated from.
        level: of the verdict: "use", "care", "stop"; "" where the page does not say.
        headline, expectation: the verdict.
        codes: of what it rests on.
        probe_from_image: (4, 4), mm from px, or None.
    """

    name: str
    title: str = ""
    made: str = ""
    source: str = ""
    level: str = ""
    headline: str = ""
    expectation: str = ""
    codes: tuple[str, ...] = ()
    probe_from_image: Array | None = None

    __repr__ = brief


class _Record(msgspec.Struct):
    """The summary's fields."""

    made: str = ""
    source: str = ""
    level: str = ""
    headline: str = ""
    expectation: str = ""
    codes: list[str] = []
    probe_from_image: list[list[float]] | None = None


def page_summary(made: str, source: str, verdict: Any, matrix: Array) -> str:
    """The text of the summary: JSON, which the page's template escapes."""
    said = {name: getattr(verdict, name) for name in ("level", "headline", "expectation", "codes")}
    return msgspec.json.encode(
        {"made": made, "source": source, **said, "probe_from_image": matrix.tolist()}
    ).decode()


def read_page(path: Path) -> Page:
    """Read what a page says of itself.

    Raises:
        InputError: it cannot be read.
        FormatError: its summary is damaged.
    """
    seen = _Head()
    seen.feed(read_at(path, 0, WITHIN).decode("utf-8", "replace"))
    title = " ".join(seen.title.split())
    if seen.summary is None:  # of an earlier sonocal
        return Page(path.name, title)
    try:
        record = msgspec.json.decode(seen.summary, type=_Record)
        rows = record.probe_from_image
        matrix = None if rows is None else np.array(rows).reshape(4, 4)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise FormatError(
            f"{path.name}: is a page of sonocal whose summary is damaged ({error}); open it in a browser"
        ) from None
    said = msgspec.structs.asdict(record) | {"codes": tuple(record.codes), "probe_from_image": matrix}
    return Page(path.name, title, **said)


class _Head(HTMLParser):
    """The title and the summary of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.title, self._in_title = "", False
        self.summary: str | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """The summary, or the begin of the title."""
        given = dict(attrs)
        if tag == "meta" and given.get("name") == NAME and self.summary is None:
            self.summary = given.get("content") or ""
        self._in_title = tag == "title" and not self.title

    def handle_data(self, data: str) -> None:
        """The title's text."""
        if self._in_title:
            self.title += data

    def handle_endtag(self, tag: str) -> None:
        """The title's end."""
        self._in_title = False
