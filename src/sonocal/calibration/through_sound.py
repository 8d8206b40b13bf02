"""A calibration on rows of a curved probe whose scanner assumes another speed of sound than there was."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from decimal import Decimal
from functools import partial

import numpy as np

from sonocal.calibration.as_scanned import nearest_similarity
from sonocal.calibration.options import Options, kept_options
from sonocal.calibration.refusals import explained
from sonocal.calibration.result import Calibration
from sonocal.calibration.rows import known_image_size, split_rows
from sonocal.calibration.sound import Sound
from sonocal.calibration.sound_options import OF_SOUND
from sonocal.calibration.sound_told import sound_findings
from sonocal.calibration.speed import SPEEDS_M_S, Asked, Rays, Speed, speed_of
from sonocal.calibration.widened import widened
from sonocal.errors import InputError, UnsupportedError
from sonocal.findings import Diagnostic, Findings
from sonocal.geometry import Array, area_places
from sonocal.observations import Observations
from sonocal.observations.outside import outside_findings
from sonocal.registration.uncertainty import quantile_95

__all__ = ["calibrate_through_sound"]

Calibrate = Callable[..., Calibration]
# As a share: trackers and rulers are no better, however many digits a scanner has.
LEAST_SAID = 0.0005


def calibrate_through_sound(observations: Observations, asked: Options, calibrate: Calibrate) -> Calibration:
    """Calibrate on the places where the rows would lie if sound ran as the scanner assumes.

    The answer holds for images in which it does, as of tissue. Where the speed was estimated, the covariance counts
    what is unknown of it: the transform follows the ratio.

        cov = cov at the ratio + g g' var(ratio),    g = d transform / d ratio

    With the scanner's mm/px the ratio follows them too, each by how well it is known.

    Args:
        observations: as scanned, held-out rows among them.
        asked: how, with the probe's radius and the speed.
        calibrate: rows whose places are right.

    Raises:
        SonocalError: as `calibrate`.
        InputError: the middle of the probe's face is not known, or no row is left to tell the speed from.
        UnsupportedError: rows are of points or planes.
    """
    plain, rows = asked.without_sound(), split_rows(observations, asked.fit_split, asked.test_split)[0]
    if not rows.lines_only:
        raise UnsupportedError(
            f"{rows.source}: has rows of points or planes, and another speed of sound is corrected for needles and "
            "wires alone; leave such rows out, or scan in a bath of the speed that the scanner assumes"
        )
    rays = _rays(asked, rows)
    with explained(rows, plain):
        speed = speed_of(rows, plain, rays)
    right = speed.corrected(observations)
    found = calibrate(right, **{one.name: getattr(plain, one.name) for one in fields(Options)})
    if rays.ratio is None and found.covariance is not None and speed.left is not None:
        found = widened(found, speed.left.covariance(found.covariance), speed.corrected(rows))
    area = _area_as_scanned(found, rows)
    sound = _sound(found, speed, asked, area)
    told = partial(_told, found, sound, rows, (asked, speed.left))
    used = replace(found.options, **{name: getattr(asked, name) for name in OF_SOUND})
    return replace(
        found,
        sound=sound,
        options=used,
        provenance=found.provenance | {"options": kept_options(asked, used)},
        diagnostics=Findings(looks=(told,)),
    )


def _told(
    found: Calibration, sound: Sound, rows: Observations, how: tuple[Options, Asked | None]
) -> list[Diagnostic]:
    """The findings: what lies outside of the image is told by where it was seen."""
    told = [one for one in found.diagnostics if one.code != "outside-image"]
    outside = outside_findings(rows.points_px[found.inlier], found.image_size_px)
    asked, left = how
    by = "the rows" if asked.scanner_mm_per_px is None else "the rows and the scanner's mm/px"
    return [*sound_findings(sound, left, by, default_face=asked.probe_face_px is None), *outside, *told]


def _rays(asked: Options, rows: Observations) -> Rays:
    """What is known of the probe.

    Raises:
        InputError: the middle of its face is not told, and the image's size says nothing of it.
    """
    face, assumed = asked.probe_face_px, asked.assumed_sound_speed_m_s
    size = known_image_size(rows, asked.image_size_px)
    if face is not None and len(face) != rows.dimension:
        raise InputError(
            f"probe_face_px must be {rows.dimension} numbers for a {rows.dimension}D probe; got {face}"
        )
    if face is None and size is None:
        raise InputError(
            f"{rows.source}: where the middle of the transducer's face is in the image is not known; give "
            "probe_face_px, or image_size_px where it is the middle of the image's top row"
        )
    if face is None:
        face = tuple(0.0 if axis == 1 else (side - 1) / 2 for axis, side in enumerate(size or ()))
    assert asked.probe_radius_mm is not None
    given = (
        None
        if isinstance(asked.sound_speed_m_s, str) or asked.sound_speed_m_s is None
        else asked.sound_speed_m_s
    )
    ratio = None if given is None else given / assumed
    bounds = (SPEEDS_M_S[0] / assumed, SPEEDS_M_S[1] / assumed)
    return Rays(face, asked.probe_radius_mm, ratio, bounds, _said(asked.scanner_mm_per_px))


def _said(scanner_mm_per_px: float | tuple[float, float] | None) -> tuple[float, float] | None:
    """The logarithm of the scanner's mm/px and its standard deviation: a number is known to half of its last digit."""
    if scanner_mm_per_px is None:
        return None
    numbers = np.atleast_1d(scanner_mm_per_px)
    digits = max(Decimal(repr(float(one))).as_tuple().exponent for one in numbers)
    rounded = 0.5 * 10.0 ** int(digits) / np.sqrt(3.0) / float(numbers.mean())
    return float(np.log(numbers).mean()), max(rounded, LEAST_SAID)


def _area_as_scanned(found: Calibration, rows: Observations) -> Array:
    """(2, d): the image, or what was seen of it, as scanned."""
    return found.area_px if found.area_is_image else _box(rows.points_px[found.inlier])


def _box(points: Array) -> Array:
    return np.array([points.min(axis=0), points.max(axis=0)])


def _sound(found: Calibration, speed: Speed, asked: Options, area: Array) -> Sound:
    """What is kept of the speed, and how far the answer is off without it."""
    assumed, fan = asked.assumed_sound_speed_m_s, speed.fan
    estimated = asked.sound_speed_m_s == "estimate"
    by_rows, p_value = None, None
    if speed.left is not None:
        by_rows, p_value = _said_by_rows(speed, speed.left, assumed, estimated=estimated)
    nearest, off = nearest_similarity(
        lambda points: found.probe_from_image @ fan.stretched(points, speed.ratio), area
    )
    corners = area_places(area)[:-1]
    moved = np.linalg.norm(speed.ignored @ corners - found.probe_from_image @ corners, axis=1)
    assert asked.probe_radius_mm is not None
    return Sound(
        speed_m_s=assumed * speed.ratio,
        assumed_m_s=assumed,
        estimated=estimated,
        by_rows_m_s=by_rows,
        p_value=p_value,
        probe_radius_mm=asked.probe_radius_mm,
        face_px=fan.face_px,
        radius_px=fan.radius_px,
        as_scanned=tuple(map(tuple, nearest.matrix.tolist())),
        as_scanned_off_mm=off,
        ignored_mm=float(moved.max()),
        ignored_at_px=tuple(corners[int(moved.argmax())].tolist()),
    )


def _said_by_rows(
    speed: Speed, left: Asked, assumed_m_s: float, *, estimated: bool
) -> tuple[tuple[float, float], float]:
    """The interval (95 %), m/s, and how often chance does as much: of an estimate at the assumed speed."""
    from scipy.special import stdtr

    ratio, half = speed.ratio - left.size, quantile_95(left.freedom) * left.deviation
    away = abs(speed.ratio - 1.0 if estimated else left.size) / left.deviation
    interval = (assumed_m_s * (ratio - half), assumed_m_s * (ratio + half))
    return interval, float(2.0 * stdtr(left.freedom, -away))
