"""The formats that matrices of other software are read from, and the function that chooses from them."""

from __future__ import annotations

from pathlib import Path

from sonocal.errors import InputError, UnsupportedError
from sonocal.existing import itk_hdf5, itk_text, numpy_file, plain_text
from sonocal.existing.choice import Choice, chosen
from sonocal.existing.matrix import Existing, Matrices
from sonocal.existing.plus import read_plus
from sonocal.files import path_of
from sonocal.files.kinds import Format, Head, recognise
from sonocal.targets.device_set import FORMAT as DEVICE_SET

__all__ = ["FORMATS", "matrices_in", "read_existing"]

FORMATS: tuple[Format, ...] = (itk_text.FORMAT, itk_hdf5.FORMAT, plain_text.FORMAT, numpy_file.FORMAT)


def read_existing(path: str | Path, choice: Choice | None = None) -> Existing:
    """The calibration that other software made: PLUS, 3D Slicer, ITK, or whatever writes a 4 x 4 matrix.

    Args:
        path: a device set (``.xml``), a transform (``.tfm``, ``.h5``), a 4 x 4 as text, or of NumPy.
        choice: which matrix, and which way it goes, where the file does not tell.

    Returns:
        The matrix that maps px to mm in the probe marker's frame.

    Raises:
        InputError: the file cannot be read, or does not tell which of its matrices is meant.
        FormatError: it is damaged, or holds no such matrix.
        UnsupportedError: it is of another kind.
    """
    return chosen(matrices_in(path), choice)


def matrices_in(path: str | Path) -> Matrices:
    """All matrices of a file.

    Raises:
        InputError, FormatError, UnsupportedError: as `read_existing`.
    """
    path = path_of(path)
    head = Head.of(path)
    if not path.is_dir() and not head.content.strip():
        raise InputError(f"{path.name}: is empty; export it again")
    found = recognise(head, (*FORMATS, DEVICE_SET))
    if found is None:
        raise UnsupportedError(
            f"{path.name}: is {head.looks_like} and holds no matrix that sonocal reads; give a PLUS device set (.xml), "
            "a transform of ITK or 3D Slicer (.tfm, .h5), or a 4 x 4 matrix (text, .npy, .npz)"
        )
    matrices: Matrices = read_plus(path) if found is DEVICE_SET else found.read(path)
    return matrices
