"""Another calibration beside the one that the page shows: how far the two are apart, as the answers change."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from sonocal.calibration import Calibration
from sonocal.errors import SonocalError

__all__ = ["Beside", "OtherOf", "Words"]

Words = Callable[[Calibration], list[str]]
"""Sentences of how far a calibration is from another one; may raise `SonocalError`."""

OtherOf = Callable[[Path], Words]
"""Reads another calibration, ours or of other software; may raise `SonocalError`."""


class Beside:
    """What the page is told of another calibration; nothing until one is given.

    Args:
        tell: tells all pages a message of a kind.
    """

    def __init__(self, tell: Callable[[str, dict[str, Any]], None]) -> None:
        self._tell = tell
        self._name = ""
        self._words: Words | None = None
        self._found: Calibration | None = None

    def give(self, name: str, words: Words) -> None:
        """Hold the answers against another calibration from now on."""
        self._name, self._words = name, words
        self.answered(self._found)

    def answered(self, found: Calibration | None) -> None:
        """Tell how far the newest answer is from it; None where there is no answer."""
        self._found = found
        if self._words is None:
            return
        told: dict[str, Any] = {"name": self._name, "sentences": []}
        try:
            told["sentences"] = [] if found is None else self._words(found)
        except SonocalError as error:
            told["refused"] = str(error)
        self._tell("beside", told)
