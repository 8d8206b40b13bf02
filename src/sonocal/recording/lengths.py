"""Are the lengths of a recording's poses what they were read as?"""

from __future__ import annotations

from collections.abc import Iterator

from sonocal.findings import Diagnostic
from sonocal.geometry.units import place_hints, unit_doubt
from sonocal.recording.model import Recording

__all__ = ["unit_findings"]


def unit_findings(recording: Recording) -> Iterator[Diagnostic]:
    """The doubt that the poses of a recording are in mm."""
    hints = [
        hint
        for poses in recording.poses.values()
        if "Image" not in (poses.source, poses.target)
        for hint in place_hints(poses.plus_name, poses.matrices[poses.valid])
    ]
    if recording.poses and not recording.provenance.lengths:
        yield Diagnostic(
            code="implausible-units",
            severity="warning",
            message=f"{recording.name}: are these millimetres? the file does not say, and they were read as that",
            advice="export it with its unit; if they are millimetres, go on with --accept-units",
        )
        return
    yield from unit_doubt(hints, f"{recording.name}: ", recording.provenance.lengths)
