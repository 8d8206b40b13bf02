"""How to calibrate from a recording: every option, checked before the first image is decoded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.options import Keywords as CalibrationKeywords
from sonocal.calibration.options import Options as CalibrationOptions
from sonocal.detection.options import Centre, DetectionOptions, check_detection_options
from sonocal.errors import InputError, UnsupportedError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.observations.image_size import size_in_words
from sonocal.recording import Recording
from sonocal.recording.poses import OnInvalid
from sonocal.registration.options import true_or_false
from sonocal.sweep.tabulate import Fixed, Posing, check_posing
from sonocal.targets import Line, Plane, Point, Target, Unplaced
from sonocal.targets.unplaced import kind_of

__all__ = [
    "Keywords",
    "Options",
    "PointsKeywords",
    "PointsOptions",
    "of_calibrate",
    "refuse_splits",
    "telling_threshold_mm",
]

THRESHOLD_MM, LEAST_THRESHOLD_MM = 5.0, 1.0
SPACING_SHARE = 0.2
"""Of the distance between wires: more, and wrong calibrations agree by taking one wire for the next."""
LINE_SAMPLES = 64
SPARE = 3
"""Candidates beyond one a wire: with twelve all of nine real wires are among them but for one in a thousand."""
PARALLEL = np.cos(np.radians(10.0))
"""Of two planes' normals: others meet at an angle that tells them apart."""


class PointsKeywords(CalibrationKeywords, total=False):
    """The options of given points as keywords of `calibrate_points`, which says what each means."""

    probe: str
    fixed: Fixed
    on_invalid: OnInvalid


class Keywords(PointsKeywords, total=False):
    """The options as keywords of `calibrate_recording`, which says what each means."""

    count: int | None
    mask: NDArray[np.bool_] | None
    centre: Centre | None
    second_look: bool


@dataclass(frozen=True)
class PointsOptions(CalibrationOptions):
    """How to calibrate from a recording and points given in its images: further options than `sonocal.calibrate` has.

    Attributes:
        probe: the tool that the probe's marker is called.
        fixed: constant ``(target, source) -> (4, 4)``, such as a device set's.
        on_invalid: what to do with poses marked valid that are not rigid: "raise" or "skip".
    """

    probe: str = "Probe"
    fixed: Fixed = field(default=None, compare=False)
    on_invalid: OnInvalid = "raise"

    __repr__ = brief

    def __post_init__(self) -> None:
        super().__post_init__()
        check_posing(self.probe, self.fixed, self.on_invalid)
        refuse_splits(self, "a recording has no splits")

    @classmethod
    def for_recording(cls, recording: Recording, **keywords: Any) -> Self:
        """The options that keywords ask for, with errors predicted at the corners of the recording's images.

        Raises:
            InputError: an option does not exist or means nothing.
        """
        own = None if recording.image is None else recording.image.size_px
        asked = cls.of(
            **(keywords if keywords.get("image_size_px") is not None else keywords | {"image_size_px": own})
        )
        if own is not None and asked.image_size_px != own:
            raise InputError(
                f"{recording.name}: has images of {size_in_words(own)} px and image_size_px says "
                f"{size_in_words(asked.image_size_px or ())}; leave it out, a recording knows its images"
            )
        return asked

    @property
    def posing(self) -> Posing:
        """How lines come into the probe marker's frame."""
        return Posing(self.probe, self.fixed, self.on_invalid)


@dataclass(frozen=True)
class Options(PointsOptions):
    """How to calibrate from a recording: further options than `PointsOptions` has.

    Attributes:
        threshold_mm: candidates further than this from their needle are wrong, rows further from their line outliers;
            "auto": rows further than 3.3 standard deviations of the chosen rows' noise.
        count: candidates an image; default: 5, and 3 in a volume; as many as wires and 3 more where there are several.
        mask: (rows, columns): where to look; default: found from the recording.
        centre: "head" (the default; "mass" of several wires), see `DetectionOptions`.
        second_look: look again near where the calibrated needle must be.
    """

    count: int | None = None
    mask: NDArray[np.bool_] | None = field(default=None, compare=False)
    centre: Centre | None = None
    second_look: bool = True

    __repr__ = brief

    def __post_init__(self) -> None:
        super().__post_init__()
        check_detection_options(self.count, self.mask, self.centre)
        true_or_false("second_look", self.second_look)

    @classmethod
    def for_lines(cls, recording: Recording, lines: Sequence[Line], **keywords: Any) -> Self:
        """As `for_recording`; without a threshold, that which tells the lines apart.

        Images and volumes of several wires show them all: as many candidates, and some to spare; in images in the
        middle of what is bright, as wires have no tail to leave out.
        """
        if len(lines) > 1 and recording.image is not None:
            if keywords.get("count") is None:
                keywords["count"] = len(lines) + SPARE
            if recording.image.dimension == 2 and keywords.get("centre") is None:
                keywords["centre"] = "mass"
        if keywords.get("threshold_mm") is None:
            keywords["threshold_mm"] = telling_threshold_mm(lines)
        return cls.for_recording(recording, **keywords)

    @classmethod
    def for_targets(cls, recording: Recording, targets: Sequence[Target], /, **keywords: Any) -> Self:
        """As `for_lines`, of any targets, refusing what is for lines alone.

        Raises:
            UnsupportedError: such an option was asked for.
        """
        if keywords.get("threshold_mm") is None:
            keywords["threshold_mm"] = telling_threshold_mm(targets)
        asked = cls.for_recording(recording, **keywords)
        for name in ("threshold_mm", "latency"):
            if (value := getattr(asked, name)) in ("auto", "estimate"):
                raise UnsupportedError(
                    f"{name} {value!r} is for needles and wires alone, and points or planes are to be found in "
                    f"{recording.name}; leave it out"
                )
        return asked

    @classmethod
    def for_unplaced(
        cls, recording: Recording, targets: Sequence[Target | Unplaced], /, **keywords: Any
    ) -> Self:
        """As `for_lines`, of targets whose place is asked for."""
        seen_as_lines = [one for one in targets if kind_of(one) != "plane"]
        if keywords.get("threshold_mm") is None:
            keywords["threshold_mm"] = THRESHOLD_MM
        if len(seen_as_lines) > 1 and recording.image is not None and recording.image.dimension == 2:
            keywords = {"count": len(seen_as_lines) + SPARE, "centre": "mass"} | {
                name: value for name, value in keywords.items() if value is not None
            }
        return cls.for_recording(recording, **keywords)

    @property
    def detection(self) -> DetectionOptions:
        """What to look for in the images."""
        return DetectionOptions(self.count, self.mask, self.centre)


def refuse_splits(options: CalibrationOptions, why: str) -> None:
    """Refuse what chooses among the rows of a table.

    Raises:
        InputError: a split was asked for.
    """
    for name in ("fit_split", "test_split"):
        if getattr(options, name) is not None:
            raise InputError(f"{name} is for tables; {why}, leave it out")


def of_calibrate(options: CalibrationOptions, **changes: Any) -> dict[str, Any]:
    """The keywords of `sonocal.calibrate` that options hold, some of them changed."""
    own = {one.name: getattr(options, one.name) for one in fields(CalibrationOptions)}
    return own | changes


def telling_threshold_mm(targets: Sequence[Target]) -> float:
    """Millimetres within which a candidate belongs to one target and not to its neighbour.

    5, or a fifth of the distance between targets of one kind and frame, so that they are not taken for one another.
    """
    apart = [
        _apart_mm(targets[i], targets[j])
        for i in range(len(targets))
        for j in range(i)
        if targets[i].frame == targets[j].frame
    ]
    return float(np.clip(SPACING_SHARE * min(apart, default=np.inf), LEAST_THRESHOLD_MM, THRESHOLD_MM))


def _apart_mm(one: Target, other: Target) -> float:
    """The least distance between two lines or points, or between parallel planes; without end for what is unlike."""
    if isinstance(one, Plane) and isinstance(other, Plane):
        away = other.points_mm.mean(axis=0) - one.points_mm.mean(axis=0)
        parallel = abs(float(_normal(one) @ _normal(other))) >= PARALLEL
        return abs(float(_normal(one) @ away)) if parallel else np.inf
    if type(one) is not type(other):
        return np.inf
    first, second = _samples(one), _samples(other)
    return float(np.linalg.norm(first[:, None] - second, axis=-1).min())


def _normal(plane: Plane) -> Array:
    normal = np.cross(*(plane.points_mm[1:] - plane.points_mm[0]))
    return np.asarray(normal / np.linalg.norm(normal))


def _samples(target: Target) -> Array:
    """(K, 3): of a line some places along it."""
    if isinstance(target, Point):
        return target.spanning_mm
    ends, steps = target.spanning_mm, np.linspace(0.0, 1.0, LINE_SAMPLES)[:, None]
    return np.asarray(ends[0] + steps * (ends[1] - ends[0]))
