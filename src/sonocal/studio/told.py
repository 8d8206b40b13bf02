"""What the page is told of the work, its marks and a refusal, as JSON has it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from sonocal.errors import DegenerateGeometryError, SonocalError
from sonocal.findings import Diagnostic
from sonocal.studio.marks import Marks
from sonocal.studio.work import Work

__all__ = ["about", "candidates_told", "findings_told", "marks_told", "refusal_told"]

MOST_CANDIDATES = 5


def about(work: Work) -> dict[str, Any]:
    """A recording in words and numbers, so that its frames can be shown before anything is found in them."""
    told: dict[str, Any] = {"name": work.name, "targets": list(work.targets), "frames": 0}
    recording = work.recording
    if recording is None or recording.image is None:
        return told
    times = recording.times
    timed = len(times) > 1 and bool(np.isfinite(times).all()) and float(np.ptp(times)) > 0
    return told | {
        "frames": len(recording.frames),
        "size_px": list(recording.image.size_px[:2]),
        "dimension": recording.image.dimension,
        "rate_hz": round((len(times) - 1) / float(np.ptp(times)), 3) if timed else None,
        "tools": list(recording.tools),
        "valid": np.flatnonzero(~recording.image_valid).tolist(),
    }


def marks_told(marks: Marks, revision: int, undoable: int) -> dict[str, Any]:
    """The sightings: frame, target, points, origin, whether dropped; and how many edits can be undone."""
    rows = [
        [frame, target, [[round(x, 3) for x in point] for point in mark.points_px], mark.origin, mark.dropped]
        for (frame, target), mark in sorted(marks.items())
    ]
    return {"revision": revision, "undoable": undoable, "marks": rows}


def candidates_told(places: Mapping[int, Sequence[tuple[float, float]]]) -> dict[str, list[list[float]]]:
    """The best places that were looked at, by frame."""
    return {
        str(frame): [[round(u, 1), round(v, 1)] for u, v in some[:MOST_CANDIDATES]]
        for frame, some in places.items()
    }


def refusal_told(error: Exception) -> dict[str, Any]:
    """Why there is no calibration: the sentence, its kind, and what was found that explains it."""
    if not isinstance(error, SonocalError):
        return {
            "kind": "bug",
            "sentence": f"sonocal made a mistake ({type(error).__name__}: {error}); the terminal shows where",
            "findings": [],
        }
    return {
        "kind": type(error).__name__,
        "code": error.code if isinstance(error, DegenerateGeometryError) else None,
        "sentence": str(error),
        "findings": findings_told(error.diagnostics),
    }


def findings_told(findings: Iterable[Diagnostic]) -> list[dict[str, str]]:
    """Findings, with what to do."""
    names = ("code", "severity", "message", "advice")
    return [{name: getattr(one, name) for name in names} for one in findings]
