"""A long recording of tools, read without cutting it: what each did, and what follows for its tip and shaft."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError, SonocalError, require
from sonocal.findings import Diagnostic, warnings_first
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.recording import Recording
from sonocal.recording.poses import OnInvalid
from sonocal.tools.calibrate import ToolCalibration
from sonocal.tools.needle import needle_from_axis
from sonocal.tools.pivot import PivotCalibration
from sonocal.tools.poses import distinct_poses
from sonocal.tools.spin import SpinCalibration
from sonocal.tools.stretches import Stretch, find_stretches

__all__ = ["ToolSession", "find_tool_session"]

# Where a recording has no times.
RATE_HZ = 20.0
FRAMES = ("tracker", "reference")
# Two pivots of one tip part by more than their own 95 % and this, mm: the marker slipped, or they are of two points.
APART_MM = 2.0


@dataclass(frozen=True, eq=False)
class ToolSession:
    """What tools did in a recording.

    Attributes:
        name: of the recording.
        reference: in whose frame places are.
        stretches: what each tool did, in the order of time; what is in none of them moved, or was not seen.
        tools: by marker, what follows for those that were pivoted or spun.
        times_s: (N,): of the recording's items, from 0.
        seen: by marker, (N,): where its pose counts.
        diagnostics: what to know, warnings first.
    """

    name: str
    reference: str
    stretches: tuple[Stretch, ...]
    tools: Mapping[str, ToolCalibration]
    times_s: Array
    seen: Mapping[str, NDArray[np.bool_]]
    diagnostics: tuple[Diagnostic, ...]

    __repr__ = brief


def find_tool_session(
    recording: Recording,
    *,
    reference: str | None = None,
    tips_mm: Mapping[str, Array] | None = None,
    on_invalid: OnInvalid = "raise",
    seed: int = 0,
) -> ToolSession:
    """Pivots, spins, touches and stillness of every tool in a long recording.

    Args:
        recording: poses of the tools.
        reference: marker that divots and landmarks are fixed to; default: "Reference" where it was tracked, else the
            tracker.
        tips_mm: tips (3,) of tools that are known: their touches are found without a pivot.
        on_invalid: what to do with poses marked valid that are not rigid.
        seed: of the random triples of poses.

    Raises:
        InputError: nothing was tracked, or no tool did anything that tells of it.
    """
    require("recording", recording, Recording)
    frame = reference or _reference(recording)
    names = _tools(recording, frame)
    if not names:
        raise InputError(f"{recording.name}: tracks no tool; a session has poses of one or more")
    times = recording.times
    times = times if np.isfinite(times).all() else np.arange(len(times)) / RATE_HZ
    stretches: list[Stretch] = []
    seen: dict[str, NDArray[np.bool_]] = {}
    repeats: list[Diagnostic] = []
    for name in names:
        poses = recording.between(frame, name, None, on_invalid)
        used, found = distinct_poses(poses.matrices, poses.valid, f"{recording.name}, {name}")
        seen[name], tip = used, _tip_of(name, tips_mm)
        repeats += found
        stretches += find_stretches(name, poses.matrices, used, times, tip_mm=tip, seed=seed)
    if not any(one.kind != "still" for one in stretches):
        raise InputError(
            f"{recording.name}: none of {', '.join(names)} was pivoted, spun or held to anything for long enough; rest "
            "a tip in a divot and tilt the tool by 30 deg to all sides for ten seconds"
        )
    tools = {name: _calibrated(name, [one for one in stretches if one.tool == name]) for name in names}
    known = {name: one for name, one in tools.items() if one is not None}
    findings = [*repeats, *(found for one in known.values() for found in one.diagnostics)]
    stretches.sort(key=lambda one: (one.first, one.tool))
    return ToolSession(
        recording.name, frame, tuple(stretches), known, times - times[0], seen, warnings_first(findings)
    )


def _tip_of(name: str, tips_mm: Mapping[str, Array] | None) -> Array | None:
    return next((tip for tool, tip in (tips_mm or {}).items() if tool.lower() == name.lower()), None)


def _reference(recording: Recording) -> str:
    frames = [frame for poses in recording.poses.values() for frame in (poses.source, poses.target)]
    return next((frame for frame in frames if frame.lower() == "reference"), "Tracker")


def _tools(recording: Recording, frame: str) -> list[str]:
    names = dict.fromkeys(poses.source for poses in recording.poses.values())
    return [name for name in names if name.lower() not in (*FRAMES, frame.lower(), "image")]


def _calibrated(tool: str, did: list[Stretch]) -> ToolCalibration | None:
    """What the best pivot and the longest spin of a tool make together."""
    pivots = [one.found for one in did if isinstance(one.found, PivotCalibration)]
    spins = [one.found for one in did if isinstance(one.found, SpinCalibration)]
    if not pivots and not spins:
        return None
    best = min(pivots, key=lambda one: one.tip_95_mm, default=None)
    spin = max(spins, key=lambda one: one.turn_deg, default=None)
    needle = None
    if best is not None and spin is not None:
        try:
            needle = needle_from_axis(best, spin, None, "needle", tool)
        except SonocalError:  # a tip that is on no axis of it: each is told by itself
            needle = None
    findings = [found for one in (best, spin, needle) if one is not None for found in one.diagnostics]
    findings += _apart(tool, best, pivots)
    return ToolCalibration(tool, () if best is None else (best,), spin, needle, warnings_first(findings))


def _apart(tool: str, best: PivotCalibration | None, pivots: list[PivotCalibration]) -> Iterator[Diagnostic]:
    """Pivots of one tool that tell two tips."""
    for one in pivots if best is not None else ():
        assert best is not None
        away = float(np.linalg.norm(one.tip_mm - best.tip_mm))
        if away > max(APART_MM, np.hypot(one.tip_95_mm, best.tip_95_mm)):
            yield Diagnostic(
                code="slipped-tip",
                severity="warning",
                message=(
                    f"{tool} was pivoted about two points {away:.1f} mm apart in its own frame; the one known best was "
                    "taken as its tip"
                ),
                advice="if both were its tip, the marker moved on it between them: fix it, and pivot again",
            )
            return
