"""Sound of another speed than the scanner assumes: what is known of it, and places in images with and without it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonocal.errors import InputError
from sonocal.geometry import FURTHEST, Array
from sonocal.geometry.fan import Fan
from sonocal.geometry.shown import brief
from sonocal.observations import Observations

__all__ = ["Sound", "seen_at_assumed_speed"]


@dataclass(frozen=True)
class Sound:
    """The speed of sound in what was scanned with a curved probe, and what it does to the image.

    The scanner takes every echo's time for a depth at the speed that it assumes. Depths below the face are
    ``assumed / speed`` times too large, along rays that fan out from the centre of the face's arc.

    Attributes:
        speed_m_s: in what was scanned, given or estimated.
        assumed_m_s: by the scanner.
        estimated: from the rows; else it was given.
        by_rows_m_s: what the rows say of it, with the scanner's mm/px where those are known: least and most (95 %);
            None: no row is to spare that would tell.
        p_value: how often chance does as much where the assumed speed is the right one; of a given one, where that is.
        probe_radius_mm: of the face.
        face_px: (d,), its middle in the image.
        radius_px: of the face, in the image.
        as_scanned: (4, 4), mm from px: the similarity that is best over the area in images as they were scanned.
        as_scanned_off_mm: how far that one is off at most, there.
        ignored_mm: how far the calibration moves at most if the speed is ignored, at the corner `ignored_at_px`.
    """

    speed_m_s: float
    assumed_m_s: float
    estimated: bool
    by_rows_m_s: tuple[float, float] | None
    p_value: float | None
    probe_radius_mm: float
    face_px: tuple[float, ...]
    radius_px: float
    as_scanned: tuple[tuple[float, ...], ...]
    as_scanned_off_mm: float
    ignored_mm: float
    ignored_at_px: tuple[float, ...]

    __repr__ = brief

    def __post_init__(self) -> None:
        matrix, numbers = np.array(self.as_scanned), (*self.face_px, *self.ignored_at_px)
        positive = (self.speed_m_s, self.assumed_m_s, self.probe_radius_mm, self.radius_px)
        if (
            matrix.shape != (4, 4)
            or not np.all(np.abs(matrix) < FURTHEST)
            or len(self.face_px) not in (2, 3)
            or not np.all(np.abs(numbers) < FURTHEST)
            or not all(0 < one < FURTHEST for one in positive)
        ):
            raise InputError("sound is not what a calibration holds of it")

    @property
    def ratio(self) -> float:
        """Of the speeds: true depths are that many times those in the image."""
        return self.speed_m_s / self.assumed_m_s

    @property
    def fan(self) -> Fan:
        """The rays in the image."""
        return Fan(self.face_px, self.radius_px)

    def at_assumed_speed(self, points_px: Array) -> Array:
        """Where points (N, d), px of an image as scanned, would lie in it if sound were as the scanner assumes."""
        return self.fan.stretched(points_px, self.ratio)

    def in_image(self, points_px: Array) -> Array:
        """The inverse of `at_assumed_speed`: where the image as scanned shows what lies at points (N, d), px."""
        return self.fan.stretched(points_px, 1.0 / self.ratio)


def seen_at_assumed_speed(sound: Sound | None, rows: Observations) -> Observations:
    """Rows of images in which sound is as in those of a calibration, as `probe_from_image` takes their places.

    Args:
        sound: of the calibration; None: as the scanner assumes.
        rows: as scanned.
    """
    return rows if sound is None else rows.with_sound(points_px=sound.at_assumed_speed(rows.points_px))
