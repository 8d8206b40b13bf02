"""What comes of a scene whose target nobody placed: its error beside the least there can be, and whether it says so."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from scipy.special import fdtri

from benchmarks.simulators.mixes import Array
from benchmarks.simulators.places import Noise, Sweep, image_corners, image_points
from benchmarks.simulators.places_bound import least_error_mm
from benchmarks.simulators.places_hand import Kind
from sonocal.errors import DegenerateGeometryError, SonocalError
from sonocal.registration.uncertainty import point_covariance, radius_95
from sonocal.registration.unplaced import Placed, UnplacedTarget, register_unplaced

__all__ = ["Outcome", "off_mm", "outcome", "registered", "rms_mm"]

FAR = 4.0
"""Times the least error: from there on an answer is another one."""


class Outcome(NamedTuple):
    """Of one scene.

    Attributes:
        error_mm: root mean square over the image; NaN where it was refused.
        least_mm: what it is at the least (Cramer and Rao); NaN where nothing tells it.
        corners: errors of the image's corners over their 95 % stated.
        place_covered: whether the place is in its 95 % region stated.
        refused: by name, for the motion that is missing.
        said: by what.
        seconds: of a processor.
    """

    error_mm: float
    least_mm: float
    corners: Array
    place_covered: bool
    refused: bool
    said: str
    seconds: float

    @property
    def found(self) -> bool:
        """Whether it is near the truth."""
        return self.error_mm < FAR * self.least_mm


def registered(scene: Sweep, kind: Kind, target: UnplacedTarget | None = None, **options: bool) -> Placed:
    """A scene's calibration; its target's place unknown, if that is not given otherwise."""
    one = UnplacedTarget(kind) if target is None else target
    body = 0 if scene.tracked else None
    asked = UnplacedTarget(kind, one.spanning_mm, one.sigma_mm, one.sigma_deg, body)
    points = scene.points_px[:, : scene.dimension]
    return register_unplaced(points, scene.poses, [asked], frame=scene.frame, **options)


def outcome(kind: Kind, scene: Sweep, *, least: bool = True) -> Outcome:
    """What came of a scene with noise."""
    least_mm = least_error_mm(scene, Noise())[0] if least else np.nan
    begin = time.process_time()
    try:
        answer = registered(scene, kind)
    except SonocalError as error:
        seconds = time.process_time() - begin
        motion = isinstance(error, DegenerateGeometryError)
        said = error.code if isinstance(error, DegenerateGeometryError) else type(error).__name__
        return Outcome(np.nan, least_mm, np.full(4, np.nan), False, motion, said, seconds)
    seconds = time.process_time() - begin
    corners = image_corners()
    covariance = point_covariance(answer.marker_from_source, answer.covariance, corners)
    stated = radius_95(covariance, answer.freedom)
    over = off_mm(answer, scene, corners) / stated
    return Outcome(rms_mm(answer, scene), least_mm, over, place_within(answer, scene), False, "", seconds)


def off_mm(answer: Placed, scene: Sweep, points: Array) -> Array:
    """(P,): how far some points of the image are off."""
    there = points @ scene.truth[:3, :3].T + scene.truth[:3, 3]
    return np.linalg.norm(answer.marker_from_source @ points - there, axis=1)


def rms_mm(answer: Placed, scene: Sweep) -> float:
    """Root mean square error over the image."""
    return float(np.sqrt(np.mean(off_mm(answer, scene, image_points(scene.dimension)) ** 2)))


def place_within(answer: Placed, scene: Sweep) -> bool:
    """Whether the true place is in the 95 % region of the one found."""
    place = answer.places[0]
    assert place.covariance is not None
    spans = len(scene.place)
    normals, along = place.axes[:, : 4 - spans], place.axes[:, 4 - spans :]
    away = scene.place[0] - place.middle_mm
    turns = np.zeros((4 - spans, spans - 1))
    if spans > 1:
        frame = np.linalg.svd(scene.place[1:] - scene.place[0])[2]
        true_along = frame[: spans - 1].T
        turns = normals.T @ true_along @ np.linalg.inv(along.T @ true_along)
    shift = normals.T @ away - turns @ (along.T @ away)
    off = np.concatenate([shift, -turns.ravel()])
    square = off @ np.linalg.solve(place.covariance, off) / len(off)
    return bool(square <= fdtri(len(off), max(answer.freedom, 1), 0.95))
