"""The console that results are printed on."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from sonocal.cli.screen.plain import harmless

__all__ = ["Terminal", "somebody_looks"]


class Terminal(Console):
    """A console whose own colours are the only control characters."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """The parts of something to print."""
        for part in super().render(renderable, options):
            yield part if part.control else Segment(harmless(part.text), part.style)

    def print(self, *objects: Any, **how: Any) -> None:
        """Print, as a console does."""
        super().print(*(harmless(one) if isinstance(one, str) else one for one in objects), **how)


def somebody_looks() -> bool:
    """Whether there is a person at a terminal and a screen for a browser to open on."""
    screen = (
        sys.platform in ("darwin", "win32") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
    return sys.stdout.isatty() and bool(screen)
