"""What a session shows of an object: one short line, whatever is in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

__all__ = ["brief", "quoted"]

# Of characters: a line of a session, and what one field may take of it.
MOST, EACH = 300, 72
# So many numbers, names or codes stand there; of more, how many there are.
FEW = 4


def brief(self: object) -> str:
    """The `__repr__` of a class of fields: ``<Lag latency_s=0.04, correlation=0.98>``.

    Units are in the fields' names. Arrays stand with their shape, tables with their length; what is empty is left out.
    """
    said = f"<{type(self).__name__}"
    for before, one in zip(" " + "," * MOST, _fields(self), strict=False):
        if len(said) + len(one) > MOST:
            return f"{said}, ...>"
        said += f"{before.strip()} {one}"
    return f"{said}>"


def quoted(text: object, most: int = 40) -> str:
    """A text in quotes, without control characters, cut where it is long."""
    whole = repr(str(text)[: most + 1])
    return whole if len(whole) <= most + 2 else f"{whole[: most - 2]}...{whole[0]}"


def _fields(self: object) -> Iterator[str]:
    for name in _names(type(self)):
        if not name.startswith("_") and (value := _shown(getattr(self, name))):
            yield f"{name}={value}"[:EACH]


def _names(kind: Any) -> Sequence[str]:
    if hasattr(kind, "__dataclass_fields__"):
        return [name for name, field in kind.__dataclass_fields__.items() if field.repr]
    return getattr(kind, "__struct_fields__", getattr(kind, "_fields", ()))


def _shown(value: Any) -> str:
    """A value in a few words; "" of one that says nothing."""
    if value is None or (isinstance(value, (str, Sequence, Mapping)) and len(value) == 0):
        return ""
    return next((say(value) for kinds, say in _WORDS if isinstance(value, kinds)), None) or _object(value)


def _array(array: np.ndarray[Any, Any]) -> str:
    if array.dtype.kind == "b":
        return f"{np.count_nonzero(array)} of {array.size}"
    if array.ndim == 1 and 0 < array.size <= FEW and array.dtype.kind in "iuf":
        return "(" + ", ".join(f"{x:.4g}" for x in array) + ")"
    return f"array of {' x '.join(map(str, array.shape))}"


def _several(first: list[Any], count: int) -> str:
    if all(hasattr(one, "code") and hasattr(one, "severity") for one in first):
        first = [one.code for one in first]
    plain = all(isinstance(one, (str, int, float, np.number)) for one in first)
    if count <= FEW and plain:
        inside = ", ".join(quoted(one, 20) if isinstance(one, str) else f"{one:.4g}" for one in first)
        return f"({inside})"
    return f"{count} of {type(first[0]).__name__}"


def _object(value: object) -> str:
    """What it says of itself where that is short; else its kind."""
    own = type(value).__module__.startswith("sonocal")
    said = repr(value) if own else ""
    return said if said and len(said) <= EACH - 24 and said.isprintable() else f"<{type(value).__name__}>"


_WORDS: tuple[tuple[Any, Callable[[Any], str]], ...] = (
    (str, quoted),
    ((bool, np.bool_, int), str),
    ((float, np.number), "{:.4g}".format),
    (np.ndarray, _array),
    (Mapping, lambda value: _several(list(value), len(value))),
    ((list, tuple), lambda value: _several(list(value[: FEW + 1]), len(value))),
)
