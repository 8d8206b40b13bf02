"""The page that ``reconstruct`` writes beside a volume."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from sonocal.cli.screen.plain import say
from sonocal.errors import SonocalError

if TYPE_CHECKING:
    from sonocal.reconstruction import Volume

__all__ = ["page_beside", "write_volume_page"]


def page_beside(output: Path) -> Path:
    """Where the page of a volume stands."""
    return output.with_suffix(".html")


def write_volume_page(volume: Volume, output: Path, axes: Any, made_of: dict[str, Any]) -> list[Path]:
    """Write the page; where that is not possible the volume stands without it, and stderr says why.

    Args:
        volume: that was written.
        output: its file.
        axes: how its axes are read.
        made_of: by name; what is None is left out.

    Returns:
        The files written.
    """
    from sonocal import __version__
    from sonocal.files import write_atomically
    from sonocal.reconstruction import volume_html

    said = [
        (name.replace("_", " "), _in_words(value)) for name, value in made_of.items() if value is not None
    ]
    path = page_beside(output)
    try:
        page = volume_html(volume, axes=axes, name=output.name, made_of=[*said, ("sonocal", __version__)])
        write_atomically(path, page)
    except SonocalError as error:
        say(f"Note: {error}", err=True)
        return []
    return [path]


def _in_words(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ", ".join(_in_words(one) for one in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
