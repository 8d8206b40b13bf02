"""What a matrix may be instead of what it was read as: the usual mistakes, each undone and tried on a scan."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sonocal.existing.choice import AS
from sonocal.existing.fitting import Rereading
from sonocal.existing.matrix import LPS_FROM_RAS, Existing, Form, affine_inverse, in_form
from sonocal.existing.meaning import meaning_of
from sonocal.geometry import Array

__all__ = ["rereadings"]

UNIT = {"metres": 1000.0, "centimetres": 10.0}
AXES = "uvw"


def rereadings(
    existing: Existing,
    dimension: int,
    size_px: Sequence[int] | None = None,
    scale_mm_per_px: float | None = None,
    *,
    images: bool = True,
) -> list[Rereading]:
    """All ways to read a matrix otherwise.

    Args:
        existing: the matrix as it was read.
        dimension: of the images.
        size_px: of the images: without it none is mirrored.
        scale_mm_per_px: what a pixel measures, for a matrix that scales nothing.
        images: those of images whose axes run otherwise, too.
    """
    ways = [*_forms(existing), *_one_sided(existing)]
    changes = [*_units(existing, scale_mm_per_px)]
    as_read = Rereading("", "", existing.matrix, "", 0)
    axes = _axes(dimension, size_px) if images else ()
    ways += [_then(as_read, change) for change in (*changes, *_parts(), *axes)]
    forms = _forms(existing)
    return ways + [_then(form, change) for form in forms for change in changes if change.whole]


@dataclass(frozen=True)
class _Change:
    """A mistake that may come on top of another.

    Attributes:
        name, words, advice: as of a `Rereading`.
        undo: from the matrix as read to what it should have been.
        whole: it is one of the matrix as a whole, which its inverse may have, too.
        of_images: as of a `Rereading`.
    """

    name: str
    words: str
    advice: str
    undo: Callable[[Array], Array]
    whole: bool = False
    of_images: bool = False


def _then(way: Rereading, change: _Change) -> Rereading:
    name = f"{way.name}+{change.name}" if way.name else change.name
    words = f"{way.words}, and {change.words}" if way.words else change.words
    advice = f"{way.advice}, and {change.advice}" if way.advice else change.advice
    return Rereading(name, words, change.undo(way.matrix), advice, way.steps + 1, change.of_images)


def _forms(existing: Existing) -> list[Rereading]:
    """The other ways to store a matrix; for all but the last there is an option."""
    stored = in_form(existing.matrix, existing.form)  # each form is its own inverse
    found = [
        Rereading(form, f"is stored {words}", in_form(stored, form), f"give --stored-as {form}")
        for form, words in AS.items()
        if form != existing.form
    ]
    turned = LPS_FROM_RAS @ stored @ LPS_FROM_RAS
    how = "export it in RAS axes, or negate the first two numbers of its columns and then of its rows"
    return [*found, Rereading("lps", "is in LPS axes instead of RAS, of image and marker", turned, how)]


def _one_sided(existing: Existing) -> Iterator[Rereading]:
    """LPS on one side alone, of the matrix or of its inverse."""
    stored = in_form(existing.matrix, existing.form)
    both: tuple[tuple[Form, Array], ...] = (("direct", stored), ("inverse", affine_inverse(stored)))
    for form, matrix in both:
        inverse = "" if form == existing.form else f"is stored {AS[form]}, and "
        option = "" if form == existing.form else f", and give --stored-as {form}"
        first = "" if form == existing.form else f"{form}+"
        steps = 1 if form == existing.form else 2
        rows, columns = ("rows", "columns") if form == "direct" else ("columns", "rows")
        yield Rereading(
            f"{first}marker-lps",
            f"{inverse}has the marker's axes in LPS instead of RAS",
            LPS_FROM_RAS @ matrix,
            f"export it in the marker's own axes, or negate its first two {rows}{option}",
            steps,
        )
        yield Rereading(
            f"{first}image-lps",
            f"{inverse}has the image's axes in LPS instead of RAS",
            matrix @ LPS_FROM_RAS,
            f"export it for u to the right and v down, or negate its first two {columns}{option}",
            steps,
        )


def _units(existing: Existing, scale_mm_per_px: float | None) -> Iterator[_Change]:
    for unit, factor in UNIT.items():
        yield _Change(
            unit,
            f"is in {unit} instead of mm",
            f"export it in mm, or multiply the first three rows of what maps px to mm by {factor:g}",
            _rows_times(factor),
            whole=True,
        )
    if scale_mm_per_px is not None and meaning_of(existing.matrix).is_rigid:
        yield _Change(
            "px-for-mm",
            "takes pixels for mm: the image's mm/px are missing in it",
            "multiply the first three columns of what maps px to mm by the scanner's mm per px (ours has "
            f"{scale_mm_per_px:.4g})",
            _columns_times(scale_mm_per_px),
            whole=True,
        )


def _parts() -> Iterator[_Change]:
    """Mistakes of one part of the matrix."""
    for unit, factor in UNIT.items():
        yield _Change(
            f"translation-{unit}",
            f"has its translation in {unit}, and its mm/px in mm",
            f"export it in mm, or multiply its translation by {factor:g}",
            _translation_times(factor),
        )
    yield _Change(
        "rotation-transposed",
        "has its rotation transposed, and its translation in place",
        "transpose its first three rows and columns, and mind which way round numbers are exported",
        _transposed,
    )


def _axes(dimension: int, size_px: Sequence[int] | None) -> Iterator[_Change]:
    """Images whose axes run otherwise than those that the matrix is for."""
    where = "see how both programs store images (rows or columns first; MF, UF ...)"
    for i in range(dimension):
        for j in range(i + 1, dimension):
            yield _Change(
                f"{AXES[i]}-{AXES[j]}-exchanged",
                f"is for images whose {AXES[i]} and {AXES[j]} are exchanged",
                f"{where}, or exchange columns {i + 1} and {j + 1} of what maps px to mm",
                _linear(np.eye(4)[:, _exchanged(i, j)]),
                of_images=True,
            )
    if size_px is None:
        return
    for i in range(dimension):
        yield _Change(
            f"{AXES[i]}-mirrored",
            f"is for images that are mirrored along {AXES[i]}",
            f"{where}, and export it for images as this scan has them",
            _linear(_flipped(size_px, [i])),
            of_images=True,
        )
    yield _Change(
        "half-turn",
        "is for images that are turned by half a turn",
        f"{where}, and export it for images as this scan has them",
        _linear(_flipped(size_px, [0, 1])),
        of_images=True,
    )


def _exchanged(i: int, j: int) -> list[int]:
    order = list(range(4))
    order[i], order[j] = j, i
    return order


def _flipped(size_px: Sequence[int], axes: Sequence[int]) -> Array:
    """(4, 4): px from px, of images that are mirrored along axes: the last pixel's centre becomes the first's."""
    matrix = np.eye(4)
    for axis in axes:
        matrix[axis, axis], matrix[axis, 3] = -1.0, size_px[axis] - 1.0
    return matrix


def _linear(right: Array) -> Callable[[Array], Array]:
    return lambda matrix: np.asarray(matrix @ right)


def _rows_times(factor: float) -> Callable[[Array], Array]:
    return lambda matrix: np.diag([factor, factor, factor, 1.0]) @ matrix


def _columns_times(factor: float) -> Callable[[Array], Array]:
    return _linear(np.diag([factor, factor, factor, 1.0]))


def _translation_times(factor: float) -> Callable[[Array], Array]:
    return lambda matrix: np.column_stack([matrix[:, :3], matrix[:, 3] * [factor, factor, factor, 1.0]])


def _transposed(matrix: Array) -> Array:
    turned = matrix.copy()
    turned[:3, :3] = matrix[:3, :3].T
    return turned
