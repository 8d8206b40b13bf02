"""Files that commands read: by their names, or ``-`` for what is piped in."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import click

from sonocal.errors import InputError

__all__ = ["NAME", "Readable", "folder_of", "without_spool"]

# What messages, and the provenance of a calibration, call what was piped in.
NAME = "stdin"
KEPT = f"{__name__}.kept"


class Readable(click.Path):
    """The path of a file to read; - is kept in a file of its own, for as long as the command runs."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path: readers of all formats look into files, and into some of them in several places."""
        if value != "-" or ctx is None:
            return super().convert(value, param, ctx)
        if KEPT in ctx.meta:
            self.fail("- stands for one file alone; name the others", param, ctx)
        folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        ctx.find_root().call_on_close(folder.cleanup)
        path = ctx.meta[KEPT] = Path(folder.name) / NAME
        try:
            with path.open("wb") as file:
                shutil.copyfileobj(sys.stdin.buffer, file)
        except OSError as error:
            raise InputError(
                f"{NAME}: cannot be kept in {folder.name} ({error.strerror}); name a file"
            ) from None
        return path


def folder_of(path: Path) -> Path:
    """The folder that a file is in; of what was piped in, where the command runs."""
    kept = click.get_current_context().meta.get(KEPT)
    return Path() if path == kept else path.parent


def without_spool(sentence: str, ctx: click.Context) -> str:
    """A sentence that calls what was piped in by its name, wherever it is kept."""
    return sentence.replace(str(ctx.meta[KEPT]), NAME) if KEPT in ctx.meta else sentence
