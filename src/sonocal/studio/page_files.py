"""The files of the page, read from the package once: what is not among them is not served."""

from __future__ import annotations

from importlib.resources import files

__all__ = ["page_files"]

KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


def page_files() -> dict[str, tuple[bytes, str]]:
    """The content and the media type of each, by name."""
    found: dict[str, tuple[bytes, str]] = {}
    for one in files("sonocal.studio").joinpath("page").iterdir():
        kind = KINDS.get(one.name[one.name.rfind(".") :])
        if kind is not None:
            found[one.name] = (one.read_bytes(), kind)
    return found
