"""What is on the desk, behind one small interface: a recording and its targets, or a table of sightings.

A session that is fed by a socket joins here: it is another `Work`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from sonocal.calibration import Calibration, calibrate
from sonocal.detection import Detections
from sonocal.errors import InputError
from sonocal.findings import Diagnostic
from sonocal.observations import Observations
from sonocal.recording import Recording, with_latency
from sonocal.recording.health import Progress
from sonocal.studio.answer import crossings
from sonocal.studio.images import SharedFrames
from sonocal.studio.marks import Key, Mark, Marks, marks_of, points_of
from sonocal.sweep import Posing, calibrate_points, sweep_of
from sonocal.targets import Line, Target, Unplaced

__all__ = ["BareWork", "Found", "Opener", "RecordingWork", "Solved", "TableWork", "Work"]


@dataclass(frozen=True, eq=False)
class Found:
    """What was found before anybody clicked.

    Attributes:
        marks: the sightings that were chosen; none where no calibration agreed with enough of them.
        candidates: by frame, all places (u, v) that were looked at, best first.
    """

    marks: Marks
    candidates: Mapping[int, Sequence[tuple[float, float]]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Solved:
    """A calibration of the sightings that take part, and the rows that it was fitted to."""

    calibration: Calibration
    rows: Observations


class Work(Protocol):
    """What a page looks at.

    Attributes:
        name: how messages call it.
        inputs: by what they are, the names and digests of its files, for the journal.
        targets: the names of what is scanned.
        of_images: what was seen in the images, which a fit of points alone does not know.
    """

    name: str
    inputs: dict[str, Any]
    targets: tuple[str, ...]
    of_images: tuple[Diagnostic, ...]

    @property
    def recording(self) -> Recording | None:
        """Its images and poses; None of a table."""

    def look(self, progress: Progress) -> Found:
        """Find the sightings; long work. Raises `SonocalError` where there are none; `candidates` may be known then."""

    @property
    def candidates(self) -> Mapping[int, Sequence[tuple[float, float]]]:
        """As `Found.candidates`, also where `look` failed."""

    def solve(self, marks: Marks, *, touched: bool) -> Solved:
        """Calibrate on sightings; `touched` says that a person changed some. Raises `SonocalError`."""

    def crosses(self, found: Calibration) -> Any:
        """(frames, targets, 2) px: where a calibration says that the lines are; None where that is not drawn."""

    def files(self, marks: Marks, *, touched: bool) -> dict[str, bytes]:
        """What the command line would write of the same sightings, by name, and what it would read for that."""


Opener = Callable[[Path, Path | None], Work]
"""A recording or a table, and what is scanned, where the table does not say."""

Files = Callable[[Marks, "Detections | Sequence[Detections] | None"], dict[str, bytes]]
"""Of the sightings that take part, or of what was detected where nobody touched any: what is exported."""


class RecordingWork:
    """A recording with its targets."""

    def __init__(
        self,
        recording: Recording,
        targets: Sequence[Target | Unplaced],
        inputs: dict[str, Any],
        *,
        looking: Mapping[str, Any],
        fitting: Mapping[str, Any],
        files: Files,
    ) -> None:
        """Put a recording on the desk.

        Args:
            recording: images and poses.
            targets: what is scanned.
            inputs: names and digests of the files.
            looking: options of `sonocal.calibrate_recording`.
            fitting: options of `sonocal.calibrate_points`.
            files: makes what is exported.

        Raises:
            InputError: as `sonocal.sweep.sweep_of`, without decoding an image.
        """
        recording = replace(recording, frames=SharedFrames(recording.frames))
        self.name, self.recording, self.inputs = recording.name, recording, inputs
        self.targets = tuple(one.name for one in targets)
        self._targets, self._fitting, self._files = targets, fitting, files
        self._sweep = sweep_of(recording, targets, **looking)
        self._seen: Any = None
        self._first: Solved | None = None
        self.of_images: tuple[Diagnostic, ...] = ()

    def look(self, progress: Progress) -> Found:
        """Detect, and choose."""
        self._seen = self._sweep.detect(progress)
        chosen = self._sweep.calibrate(self._seen)
        self._first = Solved(chosen.calibration, chosen.observations)
        self.of_images = tuple(one for one in chosen.calibration.diagnostics if one.code == "second-needle")
        return Found(marks_of(chosen.observations), self.candidates)

    @property
    def candidates(self) -> Mapping[int, Sequence[tuple[float, float]]]:
        """All that was detected."""
        if self._seen is None:
            return {}
        kinds = [self._seen] if isinstance(self._seen, Detections) else self._seen
        found: dict[int, list[tuple[float, float]]] = {}
        for kind in kinds:
            for frame, points in zip(kind.frame.tolist(), kind.points_px[:, :, :2].tolist(), strict=True):
                found.setdefault(frame, []).extend((u, v) for u, v in points)
        return found

    def solve(self, marks: Marks, *, touched: bool) -> Solved:
        """What was chosen, or a fit of what a person made of it."""
        if not touched and self._first is not None:
            return self._first
        points = points_of(marks, self.name)
        return Solved(*calibrate_points(self.recording, self._targets, points, **self._fitting))

    def crosses(self, found: Calibration) -> Any:
        """Of the lines whose place is known, under the lag that was found."""
        lines = [one for one in self._targets if isinstance(one, Line)]
        if found.dimension != 2 or not lines:
            return None
        lag, recording = found.latency_s or 0.0, self.recording
        if lag != recording.latency_s:
            recording = with_latency(recording, lag)
        how = {
            name: self._fitting[name] for name in ("probe", "fixed", "on_invalid") if name in self._fitting
        }
        places = crossings(found, Posing(**how).segments_mm(recording, lines))
        column = {one.name: i for i, one in enumerate(lines)}
        return [[row[column[name]] if name in column else None for name in self.targets] for row in places]

    def files(self, marks: Marks, *, touched: bool) -> dict[str, bytes]:
        """As the command line writes them."""
        return self._files(marks, None if touched else self._seen)


class BareWork:
    """A recording of which nobody has said what was scanned: its images can be looked at."""

    targets: tuple[str, ...] = ()
    candidates: Mapping[int, Sequence[tuple[float, float]]] = {}
    of_images: tuple[Diagnostic, ...] = ()

    def __init__(self, recording: Recording, inputs: dict[str, Any]) -> None:
        """Put a recording on the desk."""
        self.recording = replace(recording, frames=SharedFrames(recording.frames))
        self.name, self.inputs = recording.name, inputs

    def look(self, progress: Progress) -> Found:
        """Refuse: without targets there is nothing to look for."""
        raise InputError(f"{self.name}: say what was scanned: where the needle is in its marker's frame")

    def solve(self, marks: Marks, *, touched: bool) -> Solved:
        """Refuse, as `look`."""
        raise InputError(f"{self.name}: say what was scanned: where the needle is in its marker's frame")

    def crosses(self, found: Calibration) -> Any:
        """Nothing."""

    def files(self, marks: Marks, *, touched: bool) -> dict[str, bytes]:
        """Refuse, as `look`."""
        raise InputError(f"{self.name}: there is no calibration to export; say what was scanned first")


class TableWork:
    """A table of sightings: there is no image to look at, and rows can be dropped."""

    recording: Recording | None = None
    candidates: Mapping[int, Sequence[tuple[float, float]]] = {}
    of_images: tuple[Diagnostic, ...] = ()

    def __init__(
        self,
        rows: Observations,
        inputs: dict[str, Any],
        *,
        fitting: Mapping[str, Any],
        files: Callable[[Observations], dict[str, bytes]],
    ) -> None:
        """Put a table on the desk; the arguments are as of `RecordingWork`, `files` takes the rows that are left."""
        self.name, self.inputs = rows.source, inputs
        self.targets = tuple(dict.fromkeys(rows.target.tolist()))
        self._rows, self._fitting, self._files = rows, fitting, files

    def look(self, progress: Progress) -> Found:
        """The rows."""
        progress(1, 1)
        return Found(marks_of(self._rows))

    def solve(self, marks: Marks, *, touched: bool) -> Solved:
        """Calibrate on the rows that are left."""
        rows = self._left(marks) if touched else self._rows
        return Solved(calibrate(rows, **self._fitting), rows)

    def crosses(self, found: Calibration) -> Any:
        """There is no image to draw them in."""

    def files(self, marks: Marks, *, touched: bool) -> dict[str, bytes]:
        """As the command line writes them."""
        return self._files(self._left(marks) if touched else self._rows)

    def _left(self, marks: Marks) -> Observations:
        return self._rows.select(np.array([self._stays(key, marks) for key in self._keys()]))

    def _keys(self) -> list[Key]:
        return list(zip(self._rows.frame.tolist(), self._rows.target.tolist(), strict=True))

    @staticmethod
    def _stays(key: Key, marks: Marks) -> bool:
        mark: Mark | None = marks.get(key)
        return mark is None or not mark.dropped
