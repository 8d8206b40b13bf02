"""A matrix of other software: as its file holds it, and as it was read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.findings import Diagnostic
from sonocal.geometry import FURTHEST, Array, AxisScaled, frozen
from sonocal.geometry.shown import brief, quoted

__all__ = ["Existing", "Form", "Matrices", "Stored", "affine_inverse", "checked", "in_form", "slicer_form"]

Form = Literal["direct", "inverse", "slicer"]
"""How a file holds a matrix: as it maps px to mm, its inverse, or as 3D Slicer does."""

LAST_ROW = np.array([0.0, 0.0, 0.0, 1.0])
# Of the last row: programs print what they computed.
ROUNDING = 1e-9
# Of a determinant, as a share of the product of the columns' lengths: less is a plane.
FLAT = 1e-9
LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Stored:
    """One matrix of a file, as it stands there.

    Attributes:
        name: what the file calls it, such as "ImageToProbe"; "" where it has no name.
        matrix: (4, 4), last row 0 0 0 1.
        frames: its source and target, where the file says them apart from the name.
        form: how it is stored, where the file says so; None where it does not.
        transposed: the file has it with its translation in the last row; here it was turned back.
        by_scale: only its scale tells a matrix from px to mm from its inverse: files of ITK.
        stated_error_mm: what the other software says of its error; None where it says nothing.
        date: when it was made, as the file spells it.
    """

    name: str
    matrix: Array
    frames: tuple[str, str] | None = None
    form: Form | None = None
    transposed: bool = False
    by_scale: bool = False
    stated_error_mm: float | None = None
    date: str = ""

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Matrices:
    """The matrices of a file, at least one.

    Attributes:
        file: its name.
        format: as people call it.
        stored: the matrices.
    """

    file: str
    format: str
    stored: tuple[Stored, ...]

    __repr__ = brief

    def __iter__(self) -> Iterator[Stored]:
        return iter(self.stored)

    @property
    def names(self) -> str:
        """What they are called, for a message."""
        return ", ".join(one.name or "one without a name" for one in self.stored)


@dataclass(frozen=True, eq=False)
class Existing:
    """A calibration that other software made: its matrix, and nothing of how far to trust it.

    Attributes:
        file: the name of the file that it was read from.
        format: of the file, as people call it.
        transform: what the file calls it, such as "ImageToProbe"; "" where it has no name.
        matrix: (4, 4): mm in the probe marker's frame from px, whatever the file holds.
        notes: how it was read, where that is no matter of course.
        stated_error_mm: what the other software says of its error; None where it says nothing.
        date: when it was made, as the file spells it.
        form: how its file was taken to hold it.
    """

    file: str
    format: str
    transform: str
    matrix: Array
    notes: tuple[Diagnostic, ...] = ()
    stated_error_mm: float | None = None
    date: str = ""
    form: Form = "direct"

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", frozen(np.array(self.matrix, dtype=float)))

    def __repr__(self) -> str:
        scales = " x ".join(f"{s:.4g}" for s in self.probe_from_image.scales[:2])
        name = quoted(self.transform)[1:-1] or "matrix"
        return f"<Existing {name} of {quoted(self.file)}: {scales} mm/px>"

    @property
    def probe_from_image(self) -> AxisScaled:
        """The same as scales and directions; of a sheared matrix the directions are at no right angles."""
        scales = np.linalg.norm(self.matrix[:3, :3], axis=0)
        return AxisScaled(self.matrix[:3, :3] / np.where(scales > 0, scales, 1.0), self.matrix[:3, 3], scales)

    @property
    def said(self) -> str:
        """What it is, in words: ``ImageToProbe of plus.xml``."""
        return f"{self.transform or 'the matrix'} of {self.file}"


def checked(where: str, matrix: Array, name: str = "", **more: Any) -> Stored:
    """A matrix (4, 4) of a file, turned back where it is transposed.

    Args:
        where: what messages call it.
        matrix: as it stands there.
        name: what the file calls it.
        **more: further attributes of `Stored`.

    Raises:
        FormatError: it is not finite, or neither its last row nor its last column is 0 0 0 1.
        InputError: it cannot be inverted.
    """
    if not np.all(np.abs(matrix) < FURTHEST):
        raise FormatError(f"{where}: a number of its matrix is not finite, or too large; export it again")
    transposed = not _is_last(matrix[3]) and _is_last(matrix[:, 3])
    if transposed:
        matrix = matrix.T
    if not _is_last(matrix[3]):
        row = " ".join(f"{x:g}" for x in matrix[3])
        raise FormatError(
            f"{where}: the last row of a matrix from px to mm is 0 0 0 1; got {row}; is it a projection, or are its "
            "numbers in another order?"
        )
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    with np.errstate(divide="ignore"):
        volume = abs(np.linalg.det(matrix[:3, :3]))
    if not volume > FLAT * np.prod(lengths):
        raise InputError(
            f"{where}: its matrix cannot be inverted: it maps an image to a line, or has a column of zeros; where the "
            "third column is missing, put the cross product of the first two there, as long as they are"
        )
    matrix = np.vstack([matrix[:3], LAST_ROW])
    return Stored(name, frozen(matrix), transposed=transposed, **more)


def affine_inverse(matrix: Array) -> Array:
    """The inverse of a 4 x 4 whose last row is 0 0 0 1; its digits do not suffer from a distant origin.

    ``[[M, t], [0, 1]]^-1 = [[M^-1, -M^-1 t], [0, 1]]``
    """
    linear = np.linalg.inv(matrix[:3, :3])
    inverse = np.vstack([np.column_stack([linear, -linear @ matrix[:3, 3]]), LAST_ROW])
    return np.asarray(inverse)


def slicer_form(matrix: Array) -> Array:
    """(4, 4): what 3D Slicer's file holds of a transform to parent (RAS), and back: its own inverse.

    ``P M^-1 P,    P = diag(-1, -1, 1, 1)``

    Source: Slicer's developer guide, "Transforms": files hold the transform from parent, in LPS.
    """
    return np.asarray(LPS_FROM_RAS @ affine_inverse(matrix) @ LPS_FROM_RAS)


def in_form(matrix: Array, form: Form) -> Array:
    """(4, 4): mm from px, of a matrix that is stored in a form; and back: each form is its own inverse."""
    if form == "direct":
        return matrix
    return affine_inverse(matrix) if form == "inverse" else slicer_form(matrix)


def _is_last(row: Array) -> bool:
    return bool(np.abs(row - LAST_ROW).max() <= ROUNDING)
