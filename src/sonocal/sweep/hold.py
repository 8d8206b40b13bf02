"""A pose of the needle to hold in the image: in words, and as a small picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonocal.errors import require
from sonocal.geometry import Array, AxisScaled, predicted_needles
from sonocal.geometry.shown import brief

__all__ = ["Hold", "held"]

STRAIGHT_DEG = 7.5
MIDDLE_SHARE = 0.1
"""Of the image's width: nearer to the middle is in the middle."""
WAYS = (
    "to the marked side",
    "to the marked side and away from the probe",
    "away from the probe",
    "to the unmarked side and away from the probe",
    "to the unmarked side",
    "to the unmarked side and towards the probe",
    "towards the probe",
    "to the marked side and towards the probe",
)
ARROWS = "→↘↓↙←↖↑↗"
STRAIGHT = "•"
COLUMNS, ROWS = 25, 9
STEPS = tuple((round(np.cos(a)), round(np.sin(a))) for a in np.radians(45.0 * np.arange(8)))
SVG_WIDTH = 240.0


@dataclass(frozen=True)
class Hold:
    """A pose of a needle that crosses the image of a 2D probe.

    Attributes:
        place_px: (u, v): where the needle crosses.
        tilt_deg: between the needle and the image's normal, 0 to 90.
        around_deg: to where in the image its hub leans, from +u, the marked side, to +v, away from the probe.
        side: of the image on which the hub is: 1 where w > 0, else -1.
        image_size_px: (width, height).
        scale_mm_per_px: None where it is not known yet.
    """

    place_px: tuple[float, float]
    tilt_deg: float
    around_deg: float
    side: int
    image_size_px: tuple[int, int]
    scale_mm_per_px: float | None = None

    __repr__ = brief

    @property
    def direction(self) -> Array:
        """(3,): unit, from where the needle crosses to its hub, in the image's axes."""
        tilt, around = np.radians([self.tilt_deg, self.around_deg])
        return np.array(
            [np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), self.side * np.cos(tilt)]
        )

    @property
    def words(self) -> str:
        """Such as "tilt 30 degrees to the marked side, 4 cm deep, 2 cm to the unmarked side"."""
        tilt = "straight through the image"
        if self.tilt_deg >= STRAIGHT_DEG:
            tilt = f"tilt {self.tilt_deg:.0f} degrees {WAYS[self._eighth]}"
        return f"{tilt}, {self._depth}, {self._aside}"

    def misses(self, other: Hold) -> tuple[float, float]:
        """How far another pose is from this one: px, and degrees between the needles, which have no sign."""
        cosine = abs(float(self.direction @ other.direction))
        return float(np.hypot(*np.subtract(self.place_px, other.place_px))), float(
            np.degrees(np.arccos(min(cosine, 1.0)))
        )

    def sketch(self, now: Hold | None = None) -> str:
        """The image as lines of text: where the needle is to cross, an arrow to where its hub leans; "o" for now."""
        cells = [[" "] * COLUMNS for _ in range(ROWS)]
        if now is not None:
            self._put(cells, now.place_px, (0, 0), "o")
        self._put(cells, self.place_px, (0, 0), "x")
        if self.tilt_deg >= STRAIGHT_DEG:
            self._put(cells, self.place_px, STEPS[self._eighth], ARROWS[self._eighth])
        rows = [f"│{''.join(row)}│" for row in cells]
        top = f"╭{' probe '.center(COLUMNS, '─')}╮"
        return "\n".join([top, *rows, f"╰{' marked side ─'.rjust(COLUMNS, '─')}╯"])

    def svg(self, now: Hold | None = None) -> str:
        """The same as an SVG element, which is read aloud as its words."""
        width, height = self.image_size_px
        zoom = SVG_WIDTH / width
        poses = [] if now is None else [now._needle(zoom, "#888")]
        poses.append(self._needle(zoom, "#d55e00"))
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" role="img" viewBox="-8 -18 {SVG_WIDTH + 16:.0f} '
            f'{height * zoom + 36:.0f}" width="{SVG_WIDTH + 16:.0f}"><title>{self.words}</title>'
            f'<rect width="{SVG_WIDTH:.0f}" height="{height * zoom:.1f}" fill="none" stroke="currentColor"/>'
            '<g fill="currentColor" font-family="sans-serif" font-size="11">'
            f'<text x="{SVG_WIDTH / 2:.0f}" y="-5" text-anchor="middle">probe</text>'
            f'<text x="{SVG_WIDTH:.0f}" y="{height * zoom + 13:.1f}" text-anchor="end">marked side</text></g>'
            f"{''.join(poses)}</svg>"
        )

    def _needle(self, zoom: float, colour: str) -> str:
        """A dot where it crosses, and its hub's part as long as it leans."""
        u, v = np.multiply(self.place_px, zoom)
        du, dv = 0.25 * SVG_WIDTH * self.direction[:2]
        return (
            f'<g stroke="{colour}" stroke-width="3" stroke-linecap="round"><line x1="{u:.1f}" y1="{v:.1f}" '
            f'x2="{u + du:.1f}" y2="{v + dv:.1f}"/><circle cx="{u:.1f}" cy="{v:.1f}" r="5" fill="{colour}"/></g>'
        )

    @property
    def _eighth(self) -> int:
        return round(self.around_deg / 45.0) % 8

    @property
    def _depth(self) -> str:
        v, height = self.place_px[1], self.image_size_px[1]
        if self.scale_mm_per_px is None:
            return f"{100 * v / height:.0f} % of the image deep"
        return f"{_in_cm(v * self.scale_mm_per_px)} deep"

    @property
    def _aside(self) -> str:
        width = self.image_size_px[0]
        aside = self.place_px[0] - (width - 1) / 2
        if abs(aside) < MIDDLE_SHARE * width:
            return "in the middle"
        side = "to the marked side" if aside > 0 else "to the unmarked side"
        if self.scale_mm_per_px is None:
            return f"{100 * abs(aside) / width:.0f} % of the image {side}"
        return f"{_in_cm(abs(aside) * self.scale_mm_per_px)} {side}"

    def _put(
        self, cells: list[list[str]], place: tuple[float, float], step: tuple[int, int], sign: str
    ) -> None:
        width, height = self.image_size_px
        column, row = int(COLUMNS * place[0] / width) + step[0], int(ROWS * place[1] / height) + step[1]
        if 0 <= column < COLUMNS and 0 <= row < ROWS:
            cells[row][column] = sign


def held(
    probe_from_image: AxisScaled, segment_mm: Array, image_size_px: tuple[int, int], hub: int = 1
) -> Hold | None:
    """The pose that a needle is held in now; None where it is lost, or lies along the image.

    Args:
        probe_from_image: mm from px.
        segment_mm: (2, 3): its ends in the probe marker's frame; NaN where the tracker does not see it.
        image_size_px: (width, height).
        hub: which end the hand holds.
    """
    require("probe_from_image", probe_from_image, AxisScaled)
    (needle,) = predicted_needles(probe_from_image, segment_mm[None])
    along = (needle[hub] - needle[1 - hub]) * probe_from_image.scales
    if not np.isfinite(along).all() or along[2] == 0:
        return None
    u, v, _ = needle[0] - (needle[1] - needle[0]) * needle[0, 2] / (needle[1, 2] - needle[0, 2])
    tilt = np.degrees(np.arctan2(np.hypot(*along[:2]), abs(along[2])))
    around = np.degrees(np.arctan2(along[1], along[0])) % 360.0
    scale = float(probe_from_image.scales[:2].mean())
    side = 1 if along[2] > 0 else -1
    return Hold((float(u), float(v)), float(tilt), float(around), side, image_size_px, scale)


def _in_cm(length_mm: float) -> str:
    """To half a centimetre, which a hand can hold; of small images to a millimetre or so."""
    halves = round(length_mm / 5.0)
    return f"{halves / 2:.3g} cm" if halves > 1 else f"{length_mm:.0f} mm"
