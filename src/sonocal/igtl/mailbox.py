"""A queue between two threads that keeps a bounded number of bytes: the oldest fall out, and are counted."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

__all__ = ["Mailbox"]

T = TypeVar("T")


class Mailbox(Generic[T]):
    """What one thread puts in and another takes out.

    Attributes:
        dropped: how many fell out because nobody took them.
        sealed: nothing comes in any more.
    """

    def __init__(self, most: int, most_bytes: int) -> None:
        self.dropped = 0
        self.sealed = False
        self._most, self._most_bytes = most, most_bytes
        self._held: deque[tuple[T, int]] = deque()
        self._bytes = 0
        self._changed = threading.Condition()

    def __len__(self) -> int:
        return len(self._held)

    def put(self, one: T, size: int) -> None:
        """Add one of so many bytes."""
        with self._changed:
            if self.sealed:
                return
            self._held.append((one, size))
            self._bytes += size
            while len(self._held) > 1 and (len(self._held) > self._most or self._bytes > self._most_bytes):
                self._bytes -= self._held.popleft()[1]
                self.dropped += 1
            self._changed.notify()

    def take(self, timeout_s: float | None = None) -> list[T]:
        """All that is there, once something is; nothing behind the time, or where the box is sealed and empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._held or self.sealed, timeout_s)
            taken = [one for one, _ in self._held]
            self._held.clear()
            self._bytes = 0
            return taken

    def seal(self) -> None:
        """Let nothing in any more, and wake who waits."""
        with self._changed:
            self.sealed = True
            self._changed.notify_all()
