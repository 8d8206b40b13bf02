"""A recording that the command line was given, with what was said of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.recording import Recording
    from sonocal.targets import Point

__all__ = ["ESTIMATE", "OF_READING", "read_given"]

# A latency that is not given but found with the calibration.
ESTIMATE = "estimate"
# Options of all commands that read recordings of images.
OF_READING = ("poses", "angles", "markers", "latency_s", "on_invalid")


def read_given(path: Path, options: Mapping[str, Any]) -> Recording:
    """The recording, read with those of `OF_READING` that a command has."""
    from sonocal.cli.formats import require_kind
    from sonocal.recording.formats import read_recording

    require_kind(path, ("recording",))
    latency = options.get("latency_s", 0.0)
    for file in options.get("poses", ()):
        require_kind(file, ("recording",), "name the tracker's own recording with --poses")
    return read_recording(
        path,
        options.get("poses") or None,
        0.0 if latency == ESTIMATE else latency,
        options.get("on_invalid", "raise"),
        angles=options.get("angles"),
        markers=_markers(options.get("markers")),
    )


def _markers(path: Path | None) -> tuple[Point, ...]:
    """The places of markers in their tools' frames."""
    from sonocal.cli.formats import require_kind
    from sonocal.targets import read_points_toml

    if path is None:
        return ()
    require_kind(path, ("targets",), "name a file of points (.toml), each a marker in its tool's frame")
    points = read_points_toml(path)
    if not points:
        raise InputError(
            f"{path.name}: holds no points; write a [[point]] for every marker, with the tool as its frame"
        )
    return points
