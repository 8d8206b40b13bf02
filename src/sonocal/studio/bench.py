"""What a person puts on the desk step by step: the needle, found or given, and the sweep of it."""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path
from typing import Any

from sonocal.errors import InputError, SonocalError
from sonocal.studio.beside import OtherOf
from sonocal.studio.desk import Desk
from sonocal.studio.following import Following
from sonocal.studio.needle import NEEDLE, Asked, ToolOf, needle_file, tool_told
from sonocal.studio.told import refusal_told
from sonocal.studio.uploads import Uploads
from sonocal.studio.work import Opener

__all__ = ["Bench"]

LONGEST_NAME = 60
MOST_LENGTH_MM = 2000.0


class Bench:
    """Opens what the page names, and finds the needle that the sweep is of.

    Args:
        desk: what the page looks at.
        uploads: what it sent.
        opener: opens recordings and tables.
        tool_of: finds tools.
        other_of: reads calibrations to compare with.
        following: a scan that goes on, beside which nothing is opened.
    """

    def __init__(
        self,
        desk: Desk,
        uploads: Uploads,
        opener: Opener,
        tool_of: ToolOf,
        other_of: OtherOf,
        *,
        following: Following | None = None,
    ) -> None:
        self._desk, self._uploads, self._opener, self._tool_of = desk, uploads, opener, tool_of
        self._other_of, self._following = other_of, following
        self._lock = threading.Lock()
        self._source: Path | None = None
        self._needle: Path | None = None

    def open(self, source: Path, targets: Path | None) -> None:
        """Put a recording or a table on the desk; with the needle that was found, where no other is named."""
        with self._lock:
            self._source, known = source, targets or self._needle
        self._desk.put(lambda: self._opener(source, known))

    def open_named(self, asked: dict[str, Any]) -> None:
        """The same, of what the page sent: ``source`` and perhaps ``targets``.

        Raises:
            InputError: there is no such file, or a scan goes on.
        """
        self._refuse_beside_a_scan()
        targets = asked.get("targets")
        known = None if targets is None else self._uploads.path(targets)
        self.open(self._uploads.path(asked.get("source")), known)

    def compare(self, other: Path) -> None:
        """Hold what is on the desk, now and later, against another calibration.

        Raises:
            SonocalError: it is none, or cannot be read.
        """
        self._desk.beside.give(other.name, self._other_of(other))

    def compare_named(self, asked: dict[str, Any]) -> None:
        """The same, of ``other``, which the page sent.

        Raises:
            SonocalError: there is no such file, or as `compare`.
        """
        self.compare(self._uploads.path(asked.get("other")))

    def find_named(self, asked: dict[str, Any]) -> None:
        """Find a needle from ``pivot`` and ``spin`` that the page sent; ``tool`` and ``length_mm`` are as of `Asked`.

        Raises:
            SonocalError: there is no such file, a scan goes on, or as the tool's calibration.
        """
        self._refuse_beside_a_scan()
        files = {name: self._uploads.path(asked[name]) for name in ("pivot", "spin") if asked.get(name)}
        if not files:
            raise InputError("name a recording of a pivot, of a spin, or one of each")
        self.find(Asked(**files, tool=_name(asked.get("tool")), length_mm=_length(asked.get("length_mm"))))

    def find(self, asked: Asked) -> None:
        """Find a needle, tell every page, and take it for the one of the sweep.

        Raises:
            SonocalError: as the tool's calibration; that is told, too.
        """
        names = [path.name for path in (asked.pivot, asked.spin) if path is not None]
        self._desk.tell("tool", {"phase": "looking", "names": names})
        try:
            found = self._tool_of(asked)
        except Exception as error:
            self._desk.tell("tool", {"phase": "refused", "names": names, "refused": refusal_told(error)})
            raise
        content = needle_file(found)
        if content is not None:
            self._needle = self._uploads.keep(NEEDLE, content)
        kept = None if self._needle is None or content is None else str(self._needle)
        self._desk.tell("tool", {"phase": "found", "names": names, "kept": kept, **tool_told(found)})
        if content is not None and self._source is not None:
            self.open(self._source, self._needle)

    def find_aside(self, asked: Asked) -> None:
        """The same on a thread of its own: what is refused is told to the pages alone."""

        def run() -> None:
            with contextlib.suppress(SonocalError):
                self.find(asked)

        threading.Thread(target=run, name="needle", daemon=True).start()

    def _refuse_beside_a_scan(self) -> None:
        if self._following is not None:
            self._following.refuse_while_it_goes_on()


def _name(given: Any) -> str:
    if not isinstance(given, str) or not given.strip() or len(given) > LONGEST_NAME:
        raise InputError("say what the needle's marker is called in the recording, such as Needle")
    return given.strip()


def _length(given: Any) -> float | None:
    if given is None:
        return None
    if isinstance(given, bool) or not isinstance(given, (int, float)) or not 0 < given <= MOST_LENGTH_MM:
        raise InputError(
            f"the shaft's length must be from above 0 to {MOST_LENGTH_MM:g} mm; got {given!r}"[:200]
        )
    return float(given)
