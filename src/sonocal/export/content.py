"""What a file for other software is written of: a matrix, what to think of it, and its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonocal.calibration import Calibration
from sonocal.existing import Existing
from sonocal.geometry import Array
from sonocal.validation import give_verdict

__all__ = ["Content", "content_of", "which_images"]


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
    remark = f"{give_verdict(found).remark} {which_images(found)}".rstrip()
    return Content(found.probe_from_image.matrix, remark, error)


def which_images(found: Calibration | Existing) -> str:
    """For which images the map is, where sound ran at another speed than the scanner assumes; else nothing."""
    if not isinstance(found, Calibration) or found.sound is None:
        return ""
    sound = found.sound
    if (
        np.allclose(found.probe_from_image.matrix, sound.as_scanned, rtol=1e-9, atol=0.0)
        and sound.ratio != 1.0
    ):
        return (
            f"The map is for images in which sound runs at {sound.speed_m_s:.0f} m/s where the scanner assumes "
            f"{sound.assumed_m_s:.0f}: of all similarities it is the nearest, and off by up to "
            f"{sound.as_scanned_off_mm:.1f} mm."
        )
    return (
        f"The map is for images in which sound runs at {sound.assumed_m_s:.0f} m/s, as the scanner assumes, and not "
        f"for those of the bath, where it ran at {sound.speed_m_s:.0f}."
    )
