"""What is said of the speed of sound: what it does, and where it is not to be believed."""

from __future__ import annotations

from collections.abc import Iterator

from sonocal.calibration.sound import Sound
from sonocal.calibration.speed import SPEEDS_M_S, Asked
from sonocal.findings import Diagnostic

__all__ = ["sound_findings"]

# One test: one of a thousand sound scans is beyond; and in words, what the rows tell from the assumed speed.
SURE, TOLD = 0.001, 0.01
# Standard deviations, as seldom.
APART = 3.3
# Of the range that is searched: an interval as wide says nothing.
WIDEST_M_S = SPEEDS_M_S[1] - SPEEDS_M_S[0]


def sound_findings(sound: Sound, asked: Asked | None, by: str, *, default_face: bool) -> Iterator[Diagnostic]:
    """What the speed of sound does to the answer, and what speaks against it.

    Args:
        sound: as it was given or found.
        asked: what rows, and the scanner's mm/px, ask for still.
        by: what says so, where it was found.
        default_face: nobody said where the probe's face is in the image.
    """
    yield from _doubts(sound, by)
    if asked is not None:
        yield from _disagreement(sound, asked)
    face = f"{_place(sound.face_px)} px" + (
        " (by default, the middle of the image's top row)" if default_face else ""
    )
    yield Diagnostic(
        code="sound-speed",
        severity="info",
        message=(
            f"{_speed(sound, by)}; along the rays of a probe of {sound.probe_radius_mm:g} mm radius, whose face is at "
            f"{face}, depths are {100 * (1 / sound.ratio - 1):+.1f} % off, which ignored would move the calibration by "
            f"up to {sound.ignored_mm:.1f} mm, most at {_place(sound.ignored_at_px)} px"
        ),
        advice=(
            f"use it for images in which sound runs at {sound.assumed_m_s:.0f} m/s, as the scanner takes tissue to be; "
            "for images of what was scanned here the similarity that is nearest, off by up to "
            f"{sound.as_scanned_off_mm:.1f} mm, is as_scanned (sonocal export --as-scanned)"
        ),
    )


def _speed(sound: Sound, by: str) -> str:
    at = f"sound ran at {sound.speed_m_s:.0f} m/s"
    if not sound.estimated or sound.by_rows_m_s is None or sound.p_value is None:
        return f"{at} as given, where the scanner assumes {sound.assumed_m_s:.0f}"
    low, high = sound.by_rows_m_s
    known = f"{at} by {by} ({low:.0f} to {high:.0f}, 95 %)"
    if sound.p_value < TOLD:
        return f"{known} and not at the {sound.assumed_m_s:.0f} that the scanner assumes ({_chance(sound.p_value)})"
    return f"{known}, which cannot be told from the {sound.assumed_m_s:.0f} that the scanner assumes"


def _doubts(sound: Sound, by: str) -> Iterator[Diagnostic]:
    if sound.by_rows_m_s is None or sound.p_value is None:
        return
    low, high = sound.by_rows_m_s
    if sound.estimated and not SPEEDS_M_S[0] < round(sound.speed_m_s, 6) < SPEEDS_M_S[1]:
        yield _doubtful(
            f"{by} ask for a speed of sound beyond {sound.speed_m_s:.0f} m/s, which no bath has: something else "
            "stretches depth",
            "check the probe's radius, the mm/px and the needle's tip; give the speed by the bath's temperature",
        )
    elif sound.estimated and high - low > WIDEST_M_S:
        yield _doubtful(
            f"{by} leave the speed of sound open, {low:.0f} to {high:.0f} m/s (95 %)",
            "give the speed by the bath's temperature, or add sightings all over the image",
        )
    elif not sound.estimated and sound.p_value < SURE:
        yield _doubtful(
            f"sound is given as {sound.speed_m_s:.0f} m/s, and {by} speak for {low:.0f} to {high:.0f} (95 %; "
            f"{_chance(sound.p_value)})",
            "check the bath's temperature and what is in it, and the probe's radius; or say \"estimate\"",
        )


def _disagreement(sound: Sound, asked: Asked) -> Iterator[Diagnostic]:
    if abs(asked.between) > APART * asked.between_deviation:
        faster = "faster" if asked.between > 0 else "slower"
        yield _doubtful(
            f"by the scanner's mm/px sound ran {sound.assumed_m_s * abs(asked.between):.0f} m/s {faster} than by the "
            "rows, and both cannot be",
            "check the scanner's mm/px, whether images were resampled, the probe's radius and the needle's tip",
        )


def _doubtful(message: str, advice: str) -> Diagnostic:
    return Diagnostic(code="sound-speed-doubtful", severity="warning", message=message, advice=advice)


def _chance(p_value: float) -> str:
    return f"by chance once in {1 / max(p_value, 1e-6):.0f} scans"


def _place(point: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{x:.0f}" for x in point) + ")"
