"""Where commands write: never onto what they read, and onto what is there already only when told to."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from sonocal.errors import InputError
from sonocal.files import refuse_device, remove, write_into_folder

__all__ = ["OVERWRITE", "reserve", "reserve_results", "write_results"]

OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace files that are there already.")
# Options that name what is written; every other path is read.
WRITTEN = {"output", "sheet", "page", "log"}
# What a calibration's folder holds: files of one run, which mean nothing beside those of another.
RESULTS = ("calibration.json", "report.html", "validation.html", "observations.csv", "contact-sheet.png")


def reserve(*paths: Path, replaced: bool = False, read: Iterable[str] = ()) -> None:
    """Refuse to write where something would be lost; asked before long work, and again before writing.

    Args:
        *paths: files that the running command is about to write.
        replaced: that they may be replaced, whatever the command line says.
        read: files that the command reads beside those that the command line names.

    Raises:
        InputError: a path is what the command reads, or no file, or is there already and ``--overwrite`` was not given.
    """
    params = click.get_current_context().params
    told = bool(params.get("overwrite"))
    inputs = list(_paths([value for name, value in params.items() if name not in WRITTEN]))
    inputs += map(Path, read)
    for path in paths:
        _refuse_input(path, inputs)
        refuse_device(path)
    for path in paths:
        if os.path.lexists(path) and not (replaced or told):
            remedy = ", or replace it with --overwrite" if "overwrite" in params else ""
            raise InputError(f"{path}: is there already; choose another place with -o{remedy}")


def reserve_results(folder: Path, written: Mapping[str, Any] | tuple[str, ...]) -> None:
    """The same for a folder of results: what an earlier run left there counts, too, if this one would not replace it.

    Args:
        folder: of the results.
        written: names of those that the running command writes.

    Raises:
        InputError: as `reserve`.
    """
    reserve(*(folder / name for name in written))
    reserve(*(folder / name for name in RESULTS if name not in written and _is_of_a_run(folder / name)))


def write_results(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write a run's files, all or none, into a folder that then holds nothing of an earlier run's pictures and pages.

    Raises:
        InputError: as `reserve`; or a file cannot be written.
    """
    reserve_results(folder, files)
    write_into_folder(folder, files)
    for name in RESULTS:
        if name not in files and _is_of_a_run(folder / name):
            remove(folder / name)


def _is_of_a_run(path: Path) -> bool:
    """Whether it is a page or a picture of an earlier run; a table may be anybody's and misleads nobody."""
    if path.suffix not in (".html", ".png") or not path.is_file():
        return False
    with path.open("rb") as file:
        return b"sonocal" in file.read(1024)


def _paths(values: Any) -> Iterator[Path]:
    if isinstance(values, Path):
        yield values
    elif isinstance(values, (tuple, list)):
        for value in values:
            yield from _paths(value)


def _refuse_input(path: Path, inputs: list[Path]) -> None:
    for one in inputs:
        if _same(path, one):
            raise InputError(f"{path}: is what this command reads; choose another place with -o")
        if one.is_dir() and _same(path.parent, one):
            raise InputError(
                f"{path}: would lie among the files that this command reads; choose another place with -o"
            )


def _same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        return False
