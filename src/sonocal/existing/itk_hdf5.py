"""ITK's and 3D Slicer's transforms in HDF5: ``.h5``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from sonocal.errors import FormatError, UnsupportedError
from sonocal.existing.itk_parts import Part, form_said, matrices_of_parts
from sonocal.existing.matrix import Matrices
from sonocal.files import file_size
from sonocal.files.hdf5 import MAGIC, Damaged, Filtered, Item, open_hdf5
from sonocal.files.kinds import Format, Head

__all__ = ["FORMAT", "read_itk_hdf5"]

GROUP = "TransformGroup"
# ITK before 5 spelt them without an s.
PARAMETERS = ("TransformParameters", "TranformParameters")
FIXED = ("TransformFixedParameters", "TranformFixedParameters")
# A matrix takes a few kB; displacement fields take more, and are none.
SIZE_LIMIT = 16 << 20


def read_itk_hdf5(path: Path) -> Matrices:
    """The affine transforms of an HDF5 file of ITK.

    Raises:
        FormatError: it is none, or damaged.
        UnsupportedError: it is larger than a matrix, holds a transform that is none, or its numbers went through a
            filter that is not read.
    """
    size = file_size(path)
    if size > SIZE_LIMIT:
        raise UnsupportedError(
            f"{path.name}: holds {size} bytes, more than any linear transform; save the linear one alone"
        )
    try:
        root = open_hdf5(path)
        group = root.members().get(GROUP)
        if group is None:
            raise FormatError(
                f"{path.name}: is HDF5 without the group {GROUP}, which transforms of ITK and Slicer have; name one of "
                "these"
            )
        parts, remark = list(_parts(group)), root.attribute("convention")
    except Filtered as error:
        raise UnsupportedError(
            f"{path.name}: its numbers went through {error}, which is not read; save it with gzip, uncompressed, or as "
            ".tfm"
        ) from None
    except Damaged as error:
        raise FormatError(
            f"{path.name}: is HDF5 that is damaged, or other than ITK writes it ({error}); export it again, or as .tfm"
        ) from None
    return matrices_of_parts(path.name, FORMAT.name, parts, form_said(remark))


def _parts(group: Item) -> Iterator[Part]:
    members = group.members()
    for name in sorted(members, key=lambda text: (len(text), text)):
        one = members[name].members()
        if "TransformType" not in one:
            raise Damaged("a transform has no type")
        fixed, parameters = (_numbers(one, names) for names in (FIXED, PARAMETERS))
        yield Part(one["TransformType"].text(), parameters, fixed)


def _numbers(members: dict[str, Item], names: tuple[str, ...]) -> list[float]:
    return next((members[name].numbers() for name in names if name in members), [])


def _sniff(head: Head) -> bool:
    # Other programs keep other things in such files. A damaged one may still name what it held.
    named = head.content.startswith(MAGIC) and GROUP.encode() in head.content
    return GROUP in head.hdf5_names or (named and not head.hdf5_names)


FORMAT = Format(
    name="ITK and 3D Slicer transform, HDF5",
    kind="matrix",
    suffixes=(".h5", ".hdf5"),
    sniff=_sniff,
    read=read_itk_hdf5,
    holds="the same",
)
