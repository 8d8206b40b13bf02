"""What the tables of a targets' file must and may have."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sonocal.errors import InputError

__all__ = ["check_keys"]


def check_keys(where: str, table: dict[str, Any], keys: Sequence[str]) -> None:
    """Refuse a table that lacks a key, has one more, or whose name or frame is no text.

    Raises:
        InputError: it does.
    """
    if missing := [key for key in keys if key not in table]:
        raise InputError(f"{where}: lacks {', '.join(missing)}; it needs {', '.join(keys)}")
    if unknown := [key for key in table if key not in keys]:
        raise InputError(f"{where}: has the unknown key {unknown[0]!r}; known are {', '.join(keys)}")
    if not (isinstance(table["name"], str) and isinstance(table["frame"], str)):
        raise InputError(f"{where}: name and frame are text in quotes")
