"""A second line along the chosen wall: its other face, an echo of it, or another wall that the file may mean."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sonocal.detection import Detections
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.observations import Observations

__all__ = ["SecondWall", "find_second_wall", "second_wall_findings"]

PARALLEL = np.cos(np.radians(6.0))
LEAST_SEEN, LEAST_SHARE = 5, 0.4
"""Images, and of those with a chosen wall the share, in which it lies where it lies in the others."""
AT_ONE_PLACE_MM, AT_ONE_PLACE_SHARE = 0.5, 0.08
"""From the wall it is as far in all images, to so much and such a share of that."""
AS_BRIGHT = 0.9
"""Of the chosen wall's score: an echo or another face is dimmer, as a rule."""


@dataclass(frozen=True)
class SecondWall:
    """Where it lies from the chosen one.

    Attributes:
        deeper_mm: along the wall's normal, in the median; less than 0: nearer to the transducer.
        brightness: its score by the chosen one's, in the median.
        seen, images: in how many images it shows, of how many with a chosen wall.
    """

    deeper_mm: float
    brightness: float
    seen: int
    images: int

    @property
    def is_as_bright(self) -> bool:
        """Whether it is no dimmer than the chosen one, about."""
        return self.brightness >= AS_BRIGHT

    @property
    def is_above(self) -> bool:
        """Whether it is the nearer one, which is no echo of the chosen one."""
        return self.deeper_mm < 0


def find_second_wall(walls: Detections, chosen: Observations, scale_mm_per_px: float) -> SecondWall | None:
    """What lies along the chosen walls at one distance in many images, and was not chosen.

    Args:
        walls: all that was detected, lines of images or planes of volumes, with scores.
        chosen: the rows that a calibration rests on.
        scale_mm_per_px: of that calibration.
    """
    taken, beside = set(), []
    for frame, (number, others) in enumerate(_by_image(walls, chosen)):
        taken |= {frame} if len(number) else set()
        for one in number:
            beside += [(frame, *place) for other in others if (place := _beside(walls, one, other))]
    if not beside:
        return None
    frames, away, brightness = (np.array(column) for column in zip(*beside, strict=True))
    away = away * scale_mm_per_px
    alike = np.abs(away - away[:, None]) <= AT_ONE_PLACE_MM + AT_ONE_PLACE_SHARE * np.abs(away[:, None])
    seen = np.array([len(np.unique(frames[row])) for row in alike])
    enough = seen >= max(LEAST_SEEN, LEAST_SHARE * len(taken))
    if not enough.any():
        return None
    # What is nearer to the transducer is no echo, and comes before what is seen more often.
    best = int(np.argmax(np.where(enough, seen + len(taken) * (away < 0), 0)))
    there = alike[best]
    return SecondWall(
        float(np.median(away[there])), float(np.median(brightness[there])), int(seen[best]), len(taken)
    )


def _by_image(walls: Detections, chosen: Observations) -> Iterator[tuple[list[int], list[int]]]:
    """Of each image with walls, which were chosen, and which not."""
    planes = chosen.spans == 3
    for frame in np.unique(walls.frame):
        here = np.flatnonzero(walls.frame == frame).tolist()
        points = chosen.points_px[planes & (chosen.frame == frame)]
        was = [bool(len(points)) and _is_among(walls.points_px[i, 0], points) for i in here]
        yield (
            [i for i, one in zip(here, was, strict=True) if one],
            [i for i, one in zip(here, was, strict=True) if not one],
        )


def _is_among(point: Array, points: Array) -> bool:
    return bool(np.any(np.all(np.abs(points - point) < 1e-6, axis=1)))


def _beside(walls: Detections, one: int, other: int) -> tuple[float, float] | None:
    """How much deeper a parallel one lies, px, and its brightness by that of the chosen one."""
    assert walls.score is not None
    normal, also = (_normal(walls.points_px[i]) for i in (one, other))
    if abs(float(normal @ also)) < PARALLEL:
        return None
    away = (walls.points_px[other].mean(axis=0) - walls.points_px[one].mean(axis=0)) @ normal
    return float(away), float(walls.score[other] / walls.score[one])


def _normal(points: Array) -> Array:
    """Of a line or a plane through points (D, D), unit, towards the depth."""
    normal = np.linalg.svd(points[1:] - points[0])[2][-1]
    return np.asarray(normal * (1.0 if normal[1] >= 0 else -1.0))


def second_wall_findings(second: SecondWall | None) -> Iterator[Diagnostic]:
    """What to know of it."""
    if second is None:
        return
    bright = "about as bright" if second.is_as_bright else "dimmer"
    where = "nearer to the transducer" if second.is_above else "deeper"
    likelier = (
        "that one is likelier the wall, as echoes come after it, and it was not chosen"
        if second.is_above
        else "the upper one, which was chosen, is likelier the wall, as its other face and echoes come after it"
    )
    yield Diagnostic(
        code="second-wall",
        severity="warning" if second.is_above or second.is_as_bright else "info",
        message=(
            f"a second line runs along the chosen wall in {second.seen} of {second.images} images, "
            f"{abs(second.deeper_mm):.1f} mm {where} and {bright}: {likelier}"
        ),
        advice=(
            "look at the contact sheet; if the other one is the wall that the file names, the calibration is off by "
            "that much: name both walls, lower the gain, or take away what is before the wall"
        ),
    )
