"""A phantom of known shape whose place nobody knows: all its targets move together.

[phantom]
frame = "Phantom"           # of the targets that are of it
fixed_to = "Reference"      # what it keeps its place to: a tracked tool, or "Tracker"
place = "unknown"
said = [[1.0, 0.0, 0.0, 30.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 5.0], [0.0, 0.0, 0.0, 1.0]]    # to compare
sigma_mm = 0.3              # how well that is known, by its landmarks
sigma_deg = 0.3
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sonocal.errors import InputError
from sonocal.geometry import Array, frozen, real_array
from sonocal.geometry.shown import brief

__all__ = ["Phantom", "phantom_of", "phantom_text"]

KEYS, OF_SAID = ("frame", "fixed_to", "place"), ("said", "sigma_mm", "sigma_deg")
ROUNDED = 1e-3


@dataclass(frozen=True, eq=False)
class Phantom:
    """A phantom that keeps its place to something tracked, wherever that is.

    Attributes:
        frame: of its targets, such as "Phantom".
        fixed_to: what it keeps its place to, such as "Reference"; "Tracker": the room.
        said: (4, 4): where its landmarks say that it is, in that frame: to compare with what is found; None: nothing.
        sigma_mm, sigma_deg: standard deviations of that, along and about every axis.

    Raises:
        InputError: a name or a number means nothing.
    """

    frame: str
    fixed_to: str
    said: Array | None = None
    sigma_mm: float = 0.3
    sigma_deg: float = 0.3

    __repr__ = brief

    def __post_init__(self) -> None:
        for name in ("frame", "fixed_to"):
            value = getattr(self, name)
            if not isinstance(value, str) or not value:
                raise InputError(f"phantom: {name} is the name of a frame; got {str(value)[:40]!r}")
        if self.frame == self.fixed_to:
            raise InputError(
                f"phantom: frame and fixed_to are both {self.frame!r}; fixed_to is what the phantom is fixed to"
            )
        for name in ("sigma_mm", "sigma_deg"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < 1e9:
                raise InputError(f"phantom: {name} is a positive number; got {str(value)[:40]}")
        if self.said is None:
            return
        matrix = frozen(np.array(real_array("phantom: said", self.said)))
        turned = matrix[:3, :3] if matrix.shape == (4, 4) else np.zeros((3, 3))
        if not (
            np.isfinite(matrix).all()
            and np.abs(turned.T @ turned - np.eye(3)).max() < ROUNDED
            and np.linalg.det(turned) > 0
            and np.array_equal(matrix[3], [0, 0, 0, 1])
        ):
            raise InputError(
                "phantom: said is a rigid pose, four rows of four numbers; give fixed_to from frame"
            )
        object.__setattr__(self, "said", matrix)


def phantom_of(name: str, document: Mapping[str, Any]) -> Phantom | None:
    """The phantom that a targets' file holds; None where it has none.

    Raises:
        InputError: a key is missing or means nothing.
    """
    table = document.get("phantom")
    if table is None:
        return None
    if not isinstance(table, dict):
        raise InputError(f"{name}: a file has one phantom; write it as [phantom], with {', '.join(KEYS)}")
    if missing := [key for key in KEYS if key not in table]:
        raise InputError(f"{name}, phantom: lacks {', '.join(missing)}; it needs {', '.join(KEYS)}")
    if unknown := [key for key in table if key not in (*KEYS, *OF_SAID)]:
        raise InputError(
            f"{name}, phantom: has the unknown key {unknown[0]!r}; known are {', '.join((*KEYS, *OF_SAID))}"
        )
    if table["place"] != "unknown":
        raise InputError(
            f'{name}, phantom: place is {str(table["place"])[:40]!r}; write place = "unknown", and said = ... for '
            "where its landmarks say that it is"
        )
    try:
        said = None if "said" not in table else np.array(table["said"], dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name}, phantom: said is a rigid pose, four rows of four numbers") from None
    try:
        rest = {key: table[key] for key in OF_SAID[1:] if key in table}
        return Phantom(table["frame"], table["fixed_to"], said, **rest)
    except InputError as error:
        raise InputError(f"{name}, {error}") from None


def phantom_text(phantoms: Sequence[Phantom]) -> str:
    """The table of a targets' file; nothing where there is none."""
    if not phantoms:
        return ""
    one = phantoms[0]
    names = [
        json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f") for text in (one.frame, one.fixed_to)
    ]
    text = f'[phantom]\nframe = {names[0]}\nfixed_to = {names[1]}\nplace = "unknown"\n'
    if one.said is None:
        return text
    rows = ", ".join("[" + ", ".join(repr(float(x)) for x in row) + "]" for row in one.said)
    return (
        f"{text}said = [{rows}]\nsigma_mm = {float(one.sigma_mm)!r}\nsigma_deg = {float(one.sigma_deg)!r}\n"
    )
