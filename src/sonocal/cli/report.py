"""What the commands write of a report, and the pictures in it; and what they print for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from sonocal.cli.screen.plain import say
from sonocal.errors import UnsupportedError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration, LabelledDots
    from sonocal.cli.from_recording import Result
    from sonocal.cli.screen.existing import Section
    from sonocal.observations import Observations
    from sonocal.report import FrameImage
    from sonocal.validation import Comparison, Validation

__all__ = ["json_with_verdict", "pictured", "report_files"]

MOST_PICTURES = 12


def report_files(
    calibration: Calibration,
    rows: Observations | None,
    numbers: Validation | None = None,
    comparison: Comparison | None = None,
    frames: Sequence[FrameImage] = (),
    *,
    name: str = "report.html",
    other: str = "",
    differences: Sequence[Section] = (),
    labels: LabelledDots | None = None,
    images: Mapping[int, Any] = MappingProxyType({}),
) -> dict[str, bytes]:
    """The report by its file's name; nothing, and a note on stderr, where its libraries are not installed.

    Without numbers, the error of held-out rows, which the verdict weighs, is found here. The rest is as `report_html`
    has it.
    """
    from sonocal.report import report_html
    from sonocal.validation import validate

    if rows is not None and not rows.lines_only:
        rows = None  # figures of residuals are of lines
    if numbers is None and rows is not None:
        numbers = validate(calibration, rows, resample=False)
    try:
        page = report_html(
            calibration,
            rows,
            numbers,
            comparison=comparison,
            other=other,
            differences=differences,
            frames=frames,
            labels=labels,
            images=images,
        )
    except UnsupportedError as error:
        say(f"Note: {error}", err=True)
        return {}
    return {name: page}


def json_with_verdict(calibration: Calibration, content: bytes) -> dict[str, Any]:
    """A calibration's file, with the verdict and what no scan shows beside its fields, for programs."""
    import msgspec

    from sonocal.validation import cannot_show, give_verdict

    record: dict[str, Any] = msgspec.json.decode(content)
    return record | {"verdict": give_verdict(calibration), "cannot_show": cannot_show(calibration)}


def pictured(result: Result) -> dict[str, Any]:
    """The pictures in the report, by the names of its arguments: labels of wires have pictures that show more."""
    if result.labels is None:
        return {"frames": _pictures(result)}
    from sonocal.report.labels import telling_frames

    frames = telling_frames(result.labels) if result.recording is not None else []
    return {"labels": result.labels, "images": {one: _grey(result.recording, one) for one in frames}}


def _pictures(result: Result) -> list[FrameImage]:
    """Some images with the points that the calibration rests on."""
    import numpy as np

    from sonocal.report import FrameImage

    recording, rows = result.recording, result.rows
    if recording is None or recording.image is None:
        return []
    frames = np.unique(rows.frame)
    shown = []
    for frame in frames[np.unique(np.linspace(0, len(frames) - 1, MOST_PICTURES).astype(int))].tolist():
        here = rows.select(rows.frame == frame)
        lines = here.segments_mm if here.lines_only else None  # what is no line is not drawn
        shown.append(FrameImage(_grey(recording, frame), here.points_px, lines, f"frame {frame}"))
    return shown


def _grey(recording: Any, frame: int) -> Any:
    """An image as grey levels, of a volume the greatest along w."""
    import numpy as np

    from sonocal.detection import as_grey

    dimension = recording.image.dimension
    grey = as_grey(recording.frames[frame], dimension, f"{recording.name}, frame {frame}")
    return (grey if dimension == 2 else grey.max(axis=0)).clip(0, 255).astype(np.uint8)
