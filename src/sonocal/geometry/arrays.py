"""Numbers from outside: what is taken for an array of them, and what is refused in a sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError

__all__ = ["FURTHEST", "frozen", "real_array"]

# In px or mm: no room is that large, and squares of squares of it are numbers still.
FURTHEST = 1e9


def real_array(what: str, values: ArrayLike) -> NDArray[np.float64]:
    """Values as an array of real numbers, of whatever shape; not copied where they are one already.

    Args:
        what: what the message calls them.
        values: numbers.

    Raises:
        InputError: rows are of unlike length, a value is masked or is no real number.
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    if np.ma.isMaskedArray(values):
        if masked := int(np.ma.count_masked(values)):  # type: ignore[no-untyped-call]
            raise InputError(f"{what}: {masked} of the values are masked; leave out the rows that hold them")
        values = np.ma.getdata(values)
    try:
        array = np.asarray(values)
    except ValueError:
        raise InputError(f"{what}: rows are of unlike length; give each as many numbers") from None
    if array.dtype.kind not in "biufO":
        raise InputError(f"{what} must be real numbers; got {array.dtype.name} such as {_first(array)}")
    try:
        return np.asarray(array, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} must be real numbers; got objects such as {_odd(array)}") from None


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """An array that nobody may write to from here on: itself."""
    array.flags.writeable = False
    return array


def _first(array: NDArray[Any]) -> str:
    return repr(array.flat[0].item())[:40] if array.size else "none"


def _odd(array: NDArray[Any]) -> str:
    """The first of the objects that is no number."""
    for value in array.flat:
        try:
            float(value)
        except (TypeError, ValueError, OverflowError):
            return repr(value)[:40]
    return "none"
