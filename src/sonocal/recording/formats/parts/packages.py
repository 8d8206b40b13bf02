"""Packages that some formats need, imported when such a file is met."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from sonocal.errors import UnsupportedError

__all__ = ["needed"]


def needed(module: str, path: Path, sentence: str, package: str | None = None) -> Any:
    """A module of an optional package.

    Args:
        module: as it is imported.
        path: of the file, for the message.
        sentence: such as "videos need PyAV".
        package: that brings it, where that is not called as the module is.

    Raises:
        UnsupportedError: it is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        raise UnsupportedError(f"{path.name}: {sentence}; pip install {package or module}") from None
