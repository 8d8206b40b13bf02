"""What a file for other software is written of: a matrix, what to think of it, and its error."""

from __future__ import annotations

from dataclasses import dataclass

from sonocal.calibration import Calibration
from sonocal.existing import Existing
from sonocal.geometry import Array
from sonocal.validation import give_verdict

__all__ = ["Content", "content_of"]


@dataclass(frozen=True, eq=False)
class Content:
    """Of a calibration of ours, or of a matrix that is carried from one program's files to another's.

    Attributes:
        matrix: (4, 4): mm from px.
        remark: the verdict in a line, or that there is none.
        error_mm: root mean square distance of rows from their lines, or what the other program says; None if neither.
    """

    matrix: Array
    remark: str
    error_mm: float | None


def content_of(found: Calibration | Existing) -> Content:
    """What is written of either."""
    if isinstance(found, Existing):
        remark = (
            f"sonocal has no verdict on it: the matrix of {found.file}, with nothing of what it was made from"
        )
        return Content(found.matrix, remark.replace("--", "- -"), found.stated_error_mm)
    error = (found.test or found.fit).rms_mm
    return Content(found.probe_from_image.matrix, give_verdict(found).remark, error)
