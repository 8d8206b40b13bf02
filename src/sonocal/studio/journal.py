"""What a person did, kept on the disk before anything else comes of it: a line a click, written through."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import msgspec

from sonocal.errors import FormatError, InputError
from sonocal.studio.marks import Edit

__all__ = ["Journal"]

FORMAT, VERSION = "sonocal-studio-session", 1


class Journal:
    """The edits of one recording, in the order in which they were made.

    A line is whole on the disk when `append` returns, so that what was told to have been kept survives a crash of the
    program, of the browser and of the machine. Of a line that a crash cut short nobody was told; it is left out.
    """

    def __init__(self, path: Path, inputs: dict[str, Any]) -> None:
        """Open a journal, or begin one.

        Args:
            path: the file; made where it is absent.
            inputs: the names and digests of what is edited.

        Raises:
            InputError: the file cannot be written, or its edits are of another recording.
            FormatError: it is no journal.
        """
        self.path = path
        self.edits: list[Edit] = []
        self._ids: set[str] = set()
        try:
            self._file = path.open("a+b")
        except OSError as error:
            raise InputError(
                f"{path}: cannot be written ({error.strerror}); choose another folder with -o"
            ) from None
        try:
            self._read(inputs)
        except BaseException:
            self._file.close()
            raise

    def append(self, edit: Edit) -> bool:
        """Keep an edit; False where it is there already.

        Raises:
            InputError: the disk does not take it.
        """
        if edit.id in self._ids:
            return False
        self._write(edit)
        self._remember(edit)
        return True

    def close(self) -> None:
        """No further edits."""
        self._file.close()

    def _remember(self, edit: Edit) -> None:
        self.edits.append(edit)
        self._ids.add(edit.id)

    def _write(self, record: object) -> None:
        end = self._file.seek(0, os.SEEK_END)
        try:
            self._file.write(msgspec.json.encode(record) + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.truncate(end)
            raise InputError(
                f"{self.path}: the disk did not take the edit ({error.strerror}); make room"
            ) from None

    def _read(self, inputs: dict[str, Any]) -> None:
        self._file.seek(0)
        content = self._file.read()
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):  # what a crash cut short
            self._file.truncate(len(whole))
        lines = whole.splitlines()
        if not lines:
            self._write({"format": FORMAT, "version": VERSION, "inputs": inputs})
            return
        if not self._is_of(lines[0], inputs, edits=len(lines) - 1):  # nobody's yet: it has no edits
            self._file.truncate(0)
            self._write({"format": FORMAT, "version": VERSION, "inputs": inputs})
            return
        for number, line in enumerate(lines[1:], 2):
            try:
                self._remember(msgspec.json.decode(line, type=Edit))
            except msgspec.DecodeError as error:
                raise FormatError(
                    f"{self.path}, line {number}: is no edit ({error}); move the file away, or take the line out"
                ) from None

    def _is_of(self, line: bytes, inputs: dict[str, Any], edits: int) -> bool:
        """Whether the journal is of these inputs; refuses one that is no journal, or has edits of others."""
        try:
            head = msgspec.json.decode(line, type=dict[str, Any])
        except msgspec.DecodeError:
            head = {}
        if head.get("format") != FORMAT or head.get("version") != VERSION:
            raise FormatError(
                f"{self.path}: is no journal of this sonocal's studio; choose another folder with -o"
            )
        if head.get("inputs") != inputs and edits:
            names = ", ".join(str(one.get("input")) for one in dict(head.get("inputs") or {}).values())
            raise InputError(
                f"{self.path}: holds edits of another recording or other targets ({names[:200]}); choose another "
                "folder with -o"
            )
        return bool(head.get("inputs") == inputs)
