"""ITK's and 3D Slicer's transforms in HDF5: ``.h5``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, UnsupportedError
from sonocal.existing.itk_parts import Part, form_said, matrices_of_parts
from sonocal.existing.matrix import Matrices
from sonocal.files import reading
from sonocal.files.kinds import Format

__all__ = ["FORMAT", "read_itk_hdf5"]

MAGIC = b"\x89HDF\r\n\x1a\n"
GROUP = "TransformGroup"
# ITK before 5 spelt them without an s.
PARAMETERS = ("TransformParameters", "TranformParameters")
FIXED = ("TransformFixedParameters", "TranformFixedParameters")
# An affine transform has twelve; displacement fields have millions, which are not read.
MOST_NUMBERS, MOST_TRANSFORMS = 64, 1000
# Whatever the library says of a damaged file: it raises these, and names no further ones.
DAMAGE = (OSError, KeyError, RuntimeError, ValueError, TypeError, IndexError, AttributeError, MemoryError)


def read_itk_hdf5(path: Path) -> Matrices:
    """The affine transforms of an HDF5 file of ITK.

    Raises:
        FormatError: it is none, or damaged.
        UnsupportedError: h5py is not installed; or it holds a transform that is no matrix.
    """
    try:
        import h5py
    except ImportError:
        raise UnsupportedError(
            f"{path.name}: ITK's .h5 needs h5py; pip install 'sonocal[io]', or save it as .tfm"
        ) from None
    try:
        with reading(path):
            path.stat()
        with h5py.File(path, "r", locking=False) as file:
            remark = str(file.attrs.get("convention", ""))
            parts = list(_parts(path.name, file, h5py))
    except DAMAGE as error:
        raise FormatError(
            f"{path.name}: is damaged, or no HDF5 file ({error}); export it again"[:300]
        ) from None
    return matrices_of_parts(path.name, FORMAT.name, parts, form_said(remark))


def _parts(name: str, file: Any, h5py: Any) -> Iterator[Part]:
    group = _own(file, GROUP, h5py)
    if not isinstance(group, h5py.Group):
        raise FormatError(
            f"{name}: is HDF5 without the group {GROUP}, which transforms of ITK and Slicer have; name one of these"
        )
    if len(group) > MOST_TRANSFORMS:
        raise UnsupportedError(f"{name}: holds {len(group)} transforms; save the one that is the calibration")
    for key in sorted(group, key=lambda text: (len(text), text)):
        one = _own(group, key, h5py)
        kind = _text(_dataset(one, ("TransformType",), h5py))
        fixed, parameters = (_numbers(_dataset(one, names, h5py)) for names in (FIXED, PARAMETERS))
        yield Part(kind, parameters, fixed)


def _own(group: Any, key: str, h5py: Any) -> Any:
    """What is linked in the file itself: links may name any other file of this machine."""
    if not isinstance(group, h5py.Group) or not isinstance(group.get(key, getlink=True), h5py.HardLink):
        return None
    return group[key]


def _dataset(group: Any, names: tuple[str, ...], h5py: Any) -> Any:
    """The dataset of the first name that is there, if its data are in the file and few."""
    for name in names:
        found = _own(group, name, h5py)
        if isinstance(found, h5py.Dataset) and not found.external and not found.is_virtual:
            return found
    return None


def _text(dataset: Any) -> str:
    if dataset is None or dataset.size != 1:
        raise ValueError("a transform has no type")
    value = np.asarray(dataset[()]).reshape(-1)[0]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _numbers(dataset: Any) -> list[float]:
    """The numbers of a transform; none of one that has too many to be a matrix: its kind says what it is."""
    if dataset is None or dataset.size is None or dataset.size > MOST_NUMBERS:
        return []
    return [float(x) for x in np.asarray(dataset[()], dtype=float).reshape(-1)]


FORMAT = Format(
    name="ITK and 3D Slicer transform, HDF5",
    kind="matrix",
    suffixes=(".h5", ".hdf5"),
    sniff=lambda head: head.content.startswith(MAGIC),
    read=read_itk_hdf5,
    holds="the same",
    needs=("h5py",),
)
