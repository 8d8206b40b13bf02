"""What ITK's two forms of transform files share: which transforms are matrices, and the matrix of their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sonocal.errors import FormatError, UnsupportedError
from sonocal.existing.matrix import Form, Matrices, Stored, checked
from sonocal.geometry import Array

__all__ = ["Part", "form_said", "matrices_of_parts"]

# Kinds whose parameters are a 3 x 3 matrix, row by row, and a translation, about a centre.
AFFINE = ("AffineTransform", "MatrixOffsetTransformBase")
COMPOSITE = "CompositeTransform"
# What our own exports say of themselves, see `sonocal.export`.
OURS: dict[str, Form] = {"probe_from_image: maps pixels": "direct", "for 3D Slicer": "slicer"}


class Part(NamedTuple):
    """One transform of a file.

    Attributes:
        kind: as ITK spells it, such as "AffineTransform_double_3_3".
        parameters, fixed: its numbers.
    """

    kind: str
    parameters: Sequence[float]
    fixed: Sequence[float]


def matrices_of_parts(file: str, format_name: str, parts: Sequence[Part], form: Form | None) -> Matrices:
    """The matrices of a file's transforms; a composite's own entry holds none.

    Args:
        file: its name.
        format_name: of the file's form.
        parts: its transforms, in their order.
        form: which way they go, where the file says so.

    Raises:
        FormatError: it has no transform, or one lacks numbers.
        UnsupportedError: one is no matrix in three dimensions.
    """
    real = [part for part in parts if not part.kind.startswith(COMPOSITE)]
    if not real:
        raise FormatError(f"{file}: holds no transform; export it again")
    names = [""] if len(real) == 1 else [str(i) for i in range(len(real))]
    stored = tuple(_stored(file, name, part, form) for name, part in zip(names, real, strict=True))
    return Matrices(file, format_name, stored)


def form_said(text: str) -> Form | None:
    """Which way a matrix goes, where a remark of ours in the file says so."""
    return next((form for words, form in OURS.items() if words in text), None)


def _stored(file: str, name: str, part: Part, form: Form | None) -> Stored:
    kind, _, dimensions = part.kind.partition("_")
    if kind not in AFFINE or not dimensions.endswith("_3_3"):
        raise UnsupportedError(
            f"{file}: holds a transform of the kind {part.kind[:60]!r}, and a calibration is an affine transform in "
            "three dimensions (AffineTransform_double_3_3); save it as a linear transform"
        )
    parameters, centre = np.array(part.parameters, dtype=float), np.array(part.fixed or (0.0,) * 3)
    if parameters.shape != (12,) or centre.shape != (3,):
        raise FormatError(
            f"{file}: an affine transform has 12 parameters and 3 fixed ones; got {len(parameters)} and {len(centre)}; "
            "export it again"
        )
    return checked(file, _matrix(parameters, centre), name, form=form, by_scale=True)


def _matrix(parameters: Array, centre: Array) -> Array:
    """``y = M (x - c) + c + t``: source: ITK's MatrixOffsetTransformBase."""
    linear = parameters[:9].reshape(3, 3)
    # The sum as it stands where there is no centre, so that numbers come back to the last bit.
    with np.errstate(all="ignore"):
        moved = parameters[9:] + (centre - linear @ centre) if centre.any() else parameters[9:]
    return np.vstack([np.column_stack([linear, moved]), [0.0, 0.0, 0.0, 1.0]])
