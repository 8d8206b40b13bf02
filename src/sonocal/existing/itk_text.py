"""ITK's and 3D Slicer's transforms as text: ``#Insight Transform File V1.0``, mostly ``.tfm``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from sonocal.errors import FormatError
from sonocal.existing.itk_parts import Part, form_said, matrices_of_parts
from sonocal.existing.matrix import Matrices
from sonocal.files import read_text
from sonocal.files.kinds import Format

__all__ = ["FORMAT", "read_itk_text"]

MAGIC = "#Insight Transform File"
SIZE_LIMIT = 16 << 20


def read_itk_text(path: Path) -> Matrices:
    """The affine transforms of a text file of ITK.

    Raises:
        FormatError: it is none, or damaged.
        UnsupportedError: it holds a transform that is no matrix.
    """
    text = read_text(path, "a transform of ITK", SIZE_LIMIT).lstrip()
    if not text.startswith(MAGIC):
        raise FormatError(
            f"{path.name}: does not start with {MAGIC!r}; name a transform that ITK or Slicer saved"
        )
    remarks = " ".join(line for line in text.splitlines() if line.startswith("#"))
    return matrices_of_parts(path.name, FORMAT.name, list(_parts(path.name, text)), form_said(remarks))


def _parts(name: str, text: str) -> Iterator[Part]:
    kind: str | None = None
    numbers: dict[str, list[float]] = {}
    for i, line in enumerate(text.splitlines(), 1):
        key, colon, value = line.partition(":")
        if line.startswith("#") or not line.strip():
            continue
        if not colon:
            raise FormatError(f"{name}, line {i}: is no 'name: value'; got {line[:40]!r}; export it again")
        if key.strip() == "Transform":
            if kind is not None:
                yield Part(kind, numbers.get("Parameters", []), numbers.get("FixedParameters", []))
            kind, numbers = value.strip(), {}
        elif key.strip() in ("Parameters", "FixedParameters"):
            numbers[key.strip()] = _numbers(name, i, value)
    if kind is not None:
        yield Part(kind, numbers.get("Parameters", []), numbers.get("FixedParameters", []))


def _numbers(name: str, line: int, text: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        raise FormatError(
            f"{name}, line {line}: parameters are numbers; got {text.strip()[:40]!r}; export it again"
        ) from None


FORMAT = Format(
    name="ITK and 3D Slicer transform, text",
    kind="matrix",
    suffixes=(".tfm",),
    sniff=lambda head: head.text.startswith(MAGIC.encode()),
    read=read_itk_text,
    holds="affine transforms; which way they go by what our exports say, else by their scale",
)
