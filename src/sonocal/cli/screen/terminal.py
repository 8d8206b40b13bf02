"""The console that results are printed on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from sonocal.cli.screen.plain import harmless

__all__ = ["Terminal"]


class Terminal(Console):
    """A console whose own colours are the only control characters."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """The parts of something to print."""
        for part in super().render(renderable, options):
            yield part if part.control else Segment(harmless(part.text), part.style)

    def print(self, *objects: Any, **how: Any) -> None:
        """Print, as a console does."""
        super().print(*(harmless(one) if isinstance(one, str) else one for one in objects), **how)
