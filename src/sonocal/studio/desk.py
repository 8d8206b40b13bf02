"""One session: what is on the desk, what a person did, and the answer to it, worked out on a thread of its own."""

from __future__ import annotations

import secrets
import threading
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from sonocal.calibration import Calibration
from sonocal.errors import InputError, SonocalError
from sonocal.files import make_folder, write_into_folder
from sonocal.studio.answer import answer_of
from sonocal.studio.beside import Beside
from sonocal.studio.journal import Journal
from sonocal.studio.marks import Edit, Marks, edited, standing
from sonocal.studio.told import about, candidates_told, marks_told, refusal_told
from sonocal.studio.work import Work

__all__ = ["EXPORTED", "JOURNAL", "Desk"]

JOURNAL, EXPORTED = "session.jsonl", "export"
Listener = Callable[[dict[str, Any]], None]


class Desk:
    """A session, safe to use from several threads.

    What listeners are told are messages by `kind`: "work" (what is on the desk), "progress", "candidates", "marks",
    "answer", "beside" (another calibration) and "live" (a scan that goes on); a new listener is told all that stands.
    Every message has the `run` of the server, so that a page knows when it was started anew.
    """

    def __init__(self, folder: Path) -> None:
        """Begin.

        Args:
            folder: for the journal and for what is exported.
        """
        self.folder, self.run = folder, secrets.token_hex(8)
        self._lock = threading.RLock()
        self._wake = threading.Condition(self._lock)
        self._listeners: list[Listener] = []
        self._told: dict[str, dict[str, Any]] = {}
        self._work: Work | None = None
        self._journal: Journal | None = None
        self._found: Marks = {}
        self._marks: Marks = {}
        self._revision = self._solved = 0
        self._closed = False
        self._exported: dict[str, bytes] = {}
        self._opening: Callable[[], Work] | None = None
        self.beside = Beside(self.tell)
        self.tell("work", {"phase": "empty", "name": "", "folder": str(folder)})
        self._thread = threading.Thread(target=self._run, name="studio", daemon=True)
        self._thread.start()

    @property
    def work(self) -> Work | None:
        """What is on the desk."""
        return self._work

    def put(self, open_work: Callable[[], Work]) -> None:
        """Put something on the desk in place of what is there; it is opened on the thread, and refusals are told.

        Args:
            open_work: opens it; may raise `SonocalError`.
        """
        with self._wake:
            self._opening = open_work
            self.tell("work", {"phase": "opening", "name": "", "folder": str(self.folder)})
            self._wake.notify_all()

    def edit(self, edit: Edit) -> None:
        """Keep an edit, then let it have its effect.

        Raises:
            InputError: there is nothing to edit, the edit fits nothing, or the disk does not take it.
        """
        with self._wake:
            if self._journal is None or self._work is None:
                raise InputError("nothing is on the desk yet; wait until the recording is open")
            self._check(edit, self._work)
            if self._journal.append(edit):
                self._marked()

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Tell somebody all that stands and all that comes; returns what ends that."""
        with self._lock:
            for message in self._told.values():
                listener(message)
            self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def export(self) -> list[str]:
        """Write what the command line would write of the sightings as they are; every page is told the files' names.

        Raises:
            SonocalError: there is no calibration, or the folder cannot be written.
        """
        with self._lock:
            work, marks, touched = self._work, dict(self._marks), self._touched
        if work is None:
            raise InputError("there is nothing to export yet; open a recording first")
        files = work.files(marks, touched=touched)
        make_folder(self.folder / EXPORTED)
        write_into_folder(self.folder / EXPORTED, files)
        self._exported = files
        self.tell("exported", {"files": list(files), "folder": str((self.folder / EXPORTED).resolve())})
        return list(files)

    def exported(self, name: str) -> bytes | None:
        """The content of a file of the last export; None where it has none of that name."""
        return self._exported.get(name)

    def close(self) -> None:
        """End the thread."""
        with self._wake:
            self._closed = True
            self._wake.notify_all()
        if self._journal is not None:
            self._journal.close()

    @property
    def _touched(self) -> bool:
        return self._journal is not None and bool(standing(self._journal.edits))

    def _check(self, edit: Edit, work: Work) -> None:
        """Refuse an edit that would mean nothing, before it is kept."""
        key = (edit.frame, edit.target)
        if edit.action == "undo":
            if not self._touched:
                raise InputError("there is nothing to undo")
            return
        if edit.target not in work.targets:
            raise InputError(f"target {edit.target[:40]!r} is none of {', '.join(work.targets)[:200]}")
        if edit.action == "move":
            self._check_move(edit, work)
        elif key not in self._marks:
            raise InputError(f"frame {edit.frame} has no sighting of {edit.target} to {edit.action}")

    def _check_move(self, edit: Edit, work: Work) -> None:
        recording = work.recording
        if recording is None or recording.image is None:
            raise InputError(
                f"{work.name}: has no images in which a point could be moved; drop the row instead"
            )
        if not 0 <= edit.frame < len(recording):
            raise InputError(f"{work.name}: has no frame {edit.frame}")
        if edit.at_px is None or not all(
            -0.5 <= x <= size - 0.5 for x, size in zip(edit.at_px, recording.image.size_px, strict=False)
        ):
            raise InputError(f"frame {edit.frame}: {edit.at_px} is not in the image; click into it")
        if (edit.frame, edit.target) not in self._marks and recording.image.dimension == 3:
            raise InputError(
                f"frame {edit.frame}: a click does not say how deep in the volume a new point is"
            )

    def _marked(self) -> None:
        """The marks after an edit, told to all, and a new answer asked for."""
        assert self._journal is not None
        self._marks = edited(self._found, self._journal.edits)
        self._revision += 1
        count = len(standing(self._journal.edits))
        self.tell("marks", marks_told(self._marks, self._revision, count))
        self._wake.notify_all()

    def tell(self, kind: str, content: dict[str, Any]) -> None:
        """Tell all listeners, and those that come; it stands until another of its kind does."""
        message = {"kind": kind, "run": self.run, **content}
        with self._lock:
            self._told.pop(kind, None)
            self._told[kind] = message
            for listener in list(self._listeners):
                listener(message)

    def _run(self) -> None:
        """The thread: open what was put on the desk, or answer the newest edit."""
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._closed or self._opening or self._revision != self._solved)
                if self._closed:
                    return
                opening, self._opening = self._opening, None
            if opening is not None:
                self._guarded(partial(self._open, opening))
            else:
                self._guarded(self._answer)

    def _guarded(self, step: Callable[[], None]) -> None:
        """A bug is told to the page and printed with its traceback: the thread goes on."""
        try:
            step()
        except Exception as error:
            traceback.print_exc()
            with self._lock:
                self._solved = self._revision
            self.tell("answer", {"revision": self._revision, "refused": refusal_told(error)})

    def _open(self, opening: Callable[[], Work]) -> None:
        try:
            work = opening()
            make_folder(self.folder)
            journal = Journal(self.folder / JOURNAL, work.inputs)
        except SonocalError as error:
            self.tell(
                "work", {"phase": "refused", "refused": refusal_told(error), "folder": str(self.folder)}
            )
            return
        with self._wake:
            if self._journal is not None:
                self._journal.close()
            for kind in ("answer", "candidates", "progress", "marks", "exported", "live"):
                self._told.pop(kind, None)
            self._work, self._journal, self._found = work, journal, {}
            self.tell("work", {"phase": "looking", **about(work), "folder": str(self.folder)})
            self.beside.answered(None)
            self._marked()
            self._solved = self._revision  # nothing is answered before all was looked at
        self._look(work)

    def _look(self, work: Work) -> None:
        """Find the sightings; where there are none a person may still click them."""
        found: Marks = {}
        refused = None
        try:
            found = work.look(self._progress).marks
        except SonocalError as error:
            refused = refusal_told(error)
        with self._wake:
            if self._work is not work:
                return
            self._found = found
            self.tell("candidates", {"places": candidates_told(work.candidates)})
            self.tell("work", {"phase": "ready", **about(work), "folder": str(self.folder)})
            self._marked()
            if refused is not None and not self._touched:
                self._solved = self._revision
                self.tell("answer", {"revision": self._revision, "refused": refused})

    def _progress(self, done: int, total: int) -> None:
        if done == total or done % 8 == 0:
            self.tell("progress", {"done": done, "of": total})

    def _answer(self) -> None:
        """Calibrate on the marks as they are now."""
        with self._lock:
            work, marks, revision, touched = self._work, dict(self._marks), self._revision, self._touched
        assert work is not None
        told: dict[str, Any]
        found: Calibration | None = None
        try:
            solved = work.solve(marks, touched=touched)
            found = solved.calibration
            told = answer_of(solved.calibration, solved.rows, work.of_images)
            told["crosses"] = work.crosses(solved.calibration)
        except SonocalError as error:
            told = {"refused": refusal_told(error)}
        with self._lock:
            self._solved = revision
            if work is self._work:
                self.tell("answer", {"revision": revision, "touched": touched, **told})
                self.beside.answered(found)
