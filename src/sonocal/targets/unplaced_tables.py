"""Tables of targets whose place is asked for, in a targets' file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.targets.lines import Target
from sonocal.targets.toml_keys import check_keys
from sonocal.targets.unplaced import Kind, Unplaced

__all__ = ["is_unplaced", "unplaced_keys", "unplaced_of"]

PLACE_KEYS, SIGMAS, UNKNOWN = ("name", "frame", "place"), ("sigma_mm", "sigma_deg"), "unknown"


def is_unplaced(table: dict[str, Any]) -> bool:
    """Whether a table is of a target whose place is unknown, or known roughly."""
    return any(key in table for key in ("place", *SIGMAS))


def unplaced_of(
    where: str, kind: Kind, table: dict[str, Any], known: Callable[[dict[str, Any]], Target]
) -> Unplaced:
    """The target of a table.

    Args:
        where: how messages name it.
        kind: of target.
        table: its keys.
        known: makes a target of the keys that say where it is.

    Raises:
        InputError: a key is missing or means nothing.
    """
    if "place" in table:
        check_keys(where, table, PLACE_KEYS)
        if table["place"] != UNKNOWN:
            raise InputError(
                f'{where}: place is {str(table["place"])[:40]!r}; write place = "{UNKNOWN}", or where it is instead'
            )
        try:
            return Unplaced(kind, table["name"], table["frame"])
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
    sigma_mm, sigma_deg = (_sigma(where, key, table) for key in SIGMAS)
    if sigma_mm is None:
        raise InputError(f"{where}: has sigma_deg and lacks sigma_mm; say how far off its place may be, too")
    place = known({key: value for key, value in table.items() if key not in SIGMAS})
    turned = _turned_deg(place.spanning_mm, sigma_mm) if sigma_deg is None else sigma_deg
    return Unplaced(kind, place.name, place.frame, place.spanning_mm, sigma_mm, turned)


def unplaced_keys(target: Unplaced) -> str:
    """The lines of its table that say how well its place is known."""
    if target.spanning_mm is None:
        return f'place = "{UNKNOWN}"\n'
    return f"sigma_mm = {target.sigma_mm!r}\nsigma_deg = {target.sigma_deg!r}\n"


def _turned_deg(spanning_mm: Array, sigma_mm: float) -> float:
    """By how much the direction is off of what is spanned by points that are each off by so much; of a point: 1."""
    if len(spanning_mm) == 1:
        return 1.0
    reach = np.linalg.norm(spanning_mm - spanning_mm.mean(axis=0), axis=1)
    return float(np.rad2deg(np.arctan(sigma_mm / np.sqrt(np.sum(reach**2) / (len(reach) - 1)))))


def _sigma(where: str, key: str, table: dict[str, Any]) -> float | None:
    value = table.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < 1e9:
        raise InputError(f"{where}: {key} is a positive number; got {str(value)[:40]}")
    return float(value)
