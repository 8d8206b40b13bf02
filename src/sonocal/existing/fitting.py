"""Which of several ways to read a matrix otherwise fits what is known, and how that is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from sonocal.existing.matrix import Existing
from sonocal.geometry import Array

__all__ = ["Rereading", "far_off", "fitting", "in_words"]

# Of our own error: so far off is still near, and a matrix is far off beyond so many times that.
NEAR, FAR = 2.0, 3.0


@dataclass(frozen=True, eq=False)
class Rereading:
    """One way to read a matrix otherwise.

    Attributes:
        name: for programs: ``inverse``, or ``inverse+metres`` of two mistakes.
        words: what the matrix is, if this is it, to follow its name.
        matrix: (4, 4): mm from px, read so.
        advice: what to do then.
        steps: how many mistakes it undoes: one is likelier than two.
        of_images: the matrix is for images whose axes run otherwise: it or the images may be at fault.
    """

    name: str
    words: str
    matrix: Array
    advice: str
    steps: int = 1
    of_images: bool = False

    def of(self, existing: Existing) -> Existing:
        """The matrix, read so; how it had been read is no news then."""
        notes = tuple(one for one in existing.notes if one.code != "direction-by-scale")
        return replace(existing, matrix=self.matrix, notes=notes)


def far_off(as_read: float, ours: float) -> bool:
    """Whether a matrix is so far off, against our own error, that another reading is looked for."""
    return as_read > FAR * NEAR * ours


def fitting(
    ways: Sequence[Rereading], error_of: Callable[[Array], float], as_read: float, ours: float
) -> list[Rereading]:
    """Those whose error is near ours, where that of the matrix as it was read is far from it.

    Of one mistake, where one explains what is known; several are not told apart by it.
    """
    if not far_off(as_read, ours):
        return []
    for steps in sorted({way.steps for way in ways}):
        if found := [way for way in ways if way.steps == steps and error_of(way.matrix) <= NEAR * ours]:
            return found
    return []


def in_words(found: Sequence[Rereading], by: str = "these rows do") -> tuple[str, str]:
    """What the matrix is, to follow its name, and what to do.

    Args:
        found: one way, or several that fit alike.
        by: what does not tell them apart.
    """
    if len(found) == 1:
        return found[0].words, found[0].advice
    either = ", or ".join(one.words for one in found)
    todo = "; or ".join(dict.fromkeys(one.advice for one in found))
    return f"{either} (which of them, {by} not tell)", f"see which it is: {todo}"
