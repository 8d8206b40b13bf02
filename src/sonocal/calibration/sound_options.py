"""What a user says of a curved probe and of the speed of sound: checked, each alone and together."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from sonocal.errors import InputError
from sonocal.geometry import FURTHEST
from sonocal.registration.options import Model, positive_number

__all__ = ["ASSUMED_M_S", "OF_SOUND", "checked_sound"]

# The options, in the order of `checked_sound`.
OF_SOUND = ("probe_radius_mm", "sound_speed_m_s", "assumed_sound_speed_m_s", "probe_face_px")
# What scanners assume; soft tissue is within a few per cent of it.
ASSUMED_M_S = 1540.0
# Of liquids and soft tissue; cm/s, km/s and mm/us are outside.
SPEEDS_M_S = (1000.0, 2500.0)
# Of probes' faces, mm: from those inside of vessels to nearly flat ones; m and px are outside.
RADII_MM = (1.0, 1000.0)


def checked_sound(
    model: Model,
    probe_radius_mm: Any,
    sound_speed_m_s: Any,
    assumed_sound_speed_m_s: Any,
    probe_face_px: Any,
) -> dict[str, Any]:
    """The options of sound, as numbers.

    Raises:
        InputError: one of them means nothing, or nothing without another.
    """
    assumed = _within("assumed_sound_speed_m_s", assumed_sound_speed_m_s, SPEEDS_M_S, "m/s")
    speed: float | Literal["estimate"] | None = sound_speed_m_s
    if isinstance(sound_speed_m_s, str) and sound_speed_m_s != "estimate":
        raise InputError(
            f'sound_speed_m_s must be a speed in m/s or "estimate"; got {sound_speed_m_s[:60]!r}'
        )
    if sound_speed_m_s is not None and not isinstance(sound_speed_m_s, str):
        speed = _within("sound_speed_m_s", sound_speed_m_s, SPEEDS_M_S, "m/s")
    radius = None if probe_radius_mm is None else _within("probe_radius_mm", probe_radius_mm, RADII_MM, "mm")
    _refuse_halves(model, radius, speed, probe_face_px)
    face = None if probe_face_px is None else _face(probe_face_px)
    return dict(zip(OF_SOUND, (radius, speed, assumed, face), strict=True))


def _refuse_halves(model: Model, radius: float | None, speed: object, face: object) -> None:
    if speed is not None and radius is None:
        raise InputError(
            "sound_speed_m_s is for curved probes, and probe_radius_mm, the radius of the transducer's face, must be "
            "given with it; of a linear probe a wrong speed is another scale along v, which the anisotropic model finds"
        )
    if speed is None and (radius is not None or face is not None):
        name = "probe_face_px" if radius is None else "probe_radius_mm"
        raise InputError(
            f'{name} says nothing without sound_speed_m_s: give the speed in what was scanned, m/s, or "estimate"'
        )
    if speed is not None and model == "rigid":
        raise InputError(
            "scale_mm_per_px cannot be given beside sound_speed_m_s, which changes what a px is worth; give the scale "
            "as scanner_mm_per_px, which the speed's estimate takes into account"
        )
    if speed is not None and model == "anisotropic":
        raise InputError(
            "the anisotropic model is for linear probes and probe_radius_mm for curved ones; leave out one of them"
        )


def _within(name: str, value: Any, bounds: tuple[float, float], unit: str) -> float:
    number = positive_number(name, value)
    if not bounds[0] <= number <= bounds[1]:
        raise InputError(f"{name} must be from {bounds[0]:g} to {bounds[1]:g} {unit}; got {number:g}")
    return float(number)


def _face(value: Any) -> tuple[float, ...]:
    try:
        face = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        face = np.empty(0)
    if face.shape not in ((2,), (3,)) or not np.all(np.abs(face) < FURTHEST):
        raise InputError(
            f"probe_face_px must be two or three numbers, a place in the image; got {str(value)[:60]}"
        )
    return tuple(face.tolist())
