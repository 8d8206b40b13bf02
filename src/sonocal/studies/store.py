"""Results of a study in a folder: shards of trials as they come, and a manifest of what they belong to."""

from __future__ import annotations

import hashlib
import io
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.files import make_folder, read_bytes, write_atomically
from sonocal.geometry import Array
from sonocal.geometry.shown import quoted
from sonocal.studies.definition import Study
from sonocal.studies.scene import BLOCK_TRIALS

__all__ = ["FORMAT", "MANIFEST", "Store"]

FORMAT, VERSION, MANIFEST = "sonocal-study", 1, "manifest.json"
# Fields of a study that its results depend on; more trials only add to them.
DECIDING = ("seed", "scene", "factors", "methods", "threshold_mm")
# A manifest is written when so much of it is new: often enough, and not once for each of thousands of shards.
GROWN = 0.1
SHARD = re.compile(r"cell-(\d+)-trials-(\d+)-(\d+)\.npz")


class _Manifest(msgspec.Struct):
    format: str
    version: int
    sonocal: str
    study: Any
    complete: bool = False
    digest: str = ""
    shards: dict[str, str] = {}


class Store:
    """The folder of a study's results.

    A shard is one run of trials of one cell. It appears under its name only when all of it is written, and its name
    says what it holds: a folder whose run was killed holds so many whole shards, and a run into it does the rest.

    Args:
        folder: made if absent.
        study: that the results are of.
        version: of the program that makes them.

    Raises:
        InputError: the folder holds results of another study or of another version, or cannot be made.
    """

    def __init__(self, folder: Path, study: Study, version: str) -> None:
        self.folder, self.study = folder, study
        self._manifest = _Manifest(FORMAT, VERSION, version, msgspec.json.decode(msgspec.json.encode(study)))
        if (folder / MANIFEST).exists():
            earlier = _read_manifest(folder / MANIFEST)
            self._check_same(earlier)
            self._manifest.shards = earlier.shards
        make_folder(folder / "shards")
        self._write_manifest()
        self._unlisted = 0
        self._runs: list[dict[int, int]] = [{} for _ in study.cells()]
        for path in sorted((folder / "shards").iterdir()):
            self._admit(path)

    def __repr__(self) -> str:
        shards = len(self._manifest.shards)
        return f"<Store of the study {quoted(self.study.name)} in {quoted(self.folder)}: {shards} shards>"

    def missing(self, index: int) -> list[tuple[int, int]]:
        """Runs (first, last) of trials of a cell, by its index, that no shard holds; each begins at a block."""
        runs, at, trials = [], 0, self.study.trials
        for first, last in [*sorted(self._runs[index].items()), (trials, trials)]:
            if at < min(first, trials):
                runs.append((at, min(first, trials)))
            # A block that an earlier run with fewer trials has cut short is done again.
            whole = last if last >= trials else last // BLOCK_TRIALS * BLOCK_TRIALS
            at = max(at, whole)
        return runs

    def write(self, index: int, first: int, last: int, results: dict[str, Array]) -> None:
        """Keep a run of trials of a cell."""
        content = io.BytesIO()
        np.savez(content, **results)  # type: ignore[arg-type]
        path = self._shard(index, first, last)
        write_atomically(path, content.getvalue())
        self._runs[index][first] = max(last, self._runs[index].get(first, 0))
        self._list(path.name, hashlib.sha256(content.getvalue()).hexdigest())

    def read(self, index: int, name: str, method: int | None = None) -> Array:
        """All trials of a cell, in their order.

        Args:
            index: the cell's.
            name: of the array.
            method: only this one's, by its index.
        """
        pieces = self._pieces(index, name)
        return np.concatenate([piece if method is None else piece[:, method].copy() for piece in pieces])

    def _pieces(self, index: int, name: str) -> Iterator[Array]:
        """The same, shard by shard: no more than one is in memory."""
        at = 0
        for first, last in sorted(self._runs[index].items()):
            end = min(last, self.study.trials)
            if end <= at:
                continue
            with np.load(self._shard(index, first, last)) as shard:
                yield shard[name][at - first : end - first]
            at = end

    @property
    def digest(self) -> str:
        """Of all results of a complete study: the same whatever the workers, their order and restarts."""
        return self._manifest.digest

    def finish(self) -> None:
        """Write the manifest of a complete study."""
        whole = hashlib.sha256()
        for index in range(len(self._runs)):
            for name in ("errors", "wire_errors", "bound", "bound_draws"):
                for piece in self._pieces(index, name):
                    whole.update(piece.tobytes())
        self._manifest.complete, self._manifest.digest = True, whole.hexdigest()
        self._manifest.shards = {
            path.name: hashlib.sha256(path.read_bytes()).hexdigest()
            for index, runs in enumerate(self._runs)
            for path in (self._shard(index, *run) for run in sorted(runs.items()))
        }
        self._write_manifest()

    def _list(self, name: str, digest: str) -> None:
        """Keep a shard's digest; the manifest that holds all of them is written each time it has grown by a tenth."""
        self._manifest.shards[name] = digest
        self._unlisted += 1
        if self._unlisted > GROWN * len(self._manifest.shards):
            self._write_manifest()
            self._unlisted = 0

    def _shard(self, index: int, first: int, last: int) -> Path:
        return self.folder / "shards" / f"cell-{index:03d}-trials-{first:08d}-{last:08d}.npz"

    def _admit(self, path: Path) -> None:
        """Count a shard as done, unless it is not what was written under its name: then its trials are done again."""
        match = SHARD.fullmatch(path.name)
        if not match:
            return
        index, first, last = (int(text) for text in match.groups())
        if index >= len(self._runs) or first % BLOCK_TRIALS or not self._as_written(path):
            return
        self._runs[index][first] = max(last, self._runs[index].get(first, 0))

    def _as_written(self, path: Path) -> bool:
        """Whether a shard has the manifest's digest; of one that a killed run could not list, whether all is there."""
        digest = self._manifest.shards.get(path.name)
        return _sound(path) if digest is None else hashlib.sha256(read_bytes(path)).hexdigest() == digest

    def _check_same(self, other: _Manifest) -> None:
        mine, theirs = dict(self._manifest.study), dict(other.study)
        differing = [name for name in DECIDING if mine[name] != theirs.get(name)]
        if differing:
            raise InputError(
                f"{self.folder}: holds results of another study (its {differing[0]} differs); choose another folder "
                "with -o, or remove this one"
            )
        if other.sonocal != self._manifest.sonocal:
            raise InputError(
                f"{self.folder}: holds results of sonocal {other.sonocal}, and this is {self._manifest.sonocal}; "
                "choose another folder with -o, or remove this one"
            )

    def _write_manifest(self) -> None:
        write_atomically(
            self.folder / MANIFEST, msgspec.json.format(msgspec.json.encode(self._manifest)) + b"\n"
        )


def _read_manifest(path: Path) -> _Manifest:
    try:
        manifest = msgspec.json.decode(read_bytes(path), type=_Manifest)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise FormatError(
            f"{path}: is not a study's manifest ({error}); choose another folder with -o"
        ) from None
    if manifest.format != FORMAT or manifest.version != VERSION:
        raise FormatError(
            f"{path}: is {manifest.format} of version {manifest.version}, and this sonocal writes {FORMAT} of version "
            f"{VERSION}; choose another folder with -o"
        )
    return manifest


def _sound(path: Path) -> bool:
    """Whether all of a shard is there: its parts' check sums hold."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.testzip() is None
    except (OSError, zipfile.BadZipFile):
        return False
