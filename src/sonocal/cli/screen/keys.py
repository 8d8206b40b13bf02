"""Single keys from a terminal, without a line's end."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator

__all__ = ["keys"]


@contextlib.contextmanager
def keys() -> Iterator[Callable[[], str]]:
    """Within it, a function gives the key that was pressed since the last call, "" for none; the terminal is mended."""
    if not sys.stdin.isatty():
        yield lambda: ""
    elif sys.platform == "win32":
        import msvcrt

        yield lambda: msvcrt.getwch() if msvcrt.kbhit() else ""
    else:
        yield from _posix()


def _posix() -> Iterator[Callable[[], str]]:
    import os
    import select
    import termios
    import tty

    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)

    def pressed() -> str:
        there = select.select([descriptor], [], [], 0)[0]
        return os.read(descriptor, 32).decode(errors="replace") if there else ""

    try:
        tty.setcbreak(descriptor)  # ctrl-C still interrupts
        yield pressed
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
