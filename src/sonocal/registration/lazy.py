"""What is looked for when it is first read, once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

__all__ = ["Lazy", "found"]

T = TypeVar("T")


class Lazy(Generic[T]):
    """Something that is looked for when it is first read; copied and sent elsewhere, it is read first."""

    def __init__(self, look: Callable[[], T]) -> None:
        self._look = look
        self._found: T | None = None

    def read(self) -> T:
        """What was found."""
        if self._found is None:
            self._found = self._look()
        return self._found

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Lazy) and self.read() == other.read()

    __hash__ = None  # type: ignore[assignment]  # to be hashed it would have to be looked for

    def __reduce__(self) -> tuple[Callable[[T], Lazy[T]], tuple[T]]:
        return found, (self.read(),)


def found(value: T) -> Lazy[T]:
    """One that was looked for before, as in a file."""
    return Lazy(lambda: value)
