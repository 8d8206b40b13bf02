"""How to calibrate: registration's options, and those of a table, an image and a set-up; each checked once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Self, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from sonocal.calibration.sound_options import ASSUMED_M_S, OF_SOUND, checked_sound
from sonocal.errors import InputError, require
from sonocal.geometry import FURTHEST
from sonocal.geometry.shown import brief
from sonocal.registration.options import Model, Weighting, one_of, positive_number, true_or_false
from sonocal.registration.options import Options as RegistrationOptions
from sonocal.targets import Line, Plane, Point, Unplaced, check_lines

__all__ = ["Keywords", "Options", "kept_options"]


class Keywords(TypedDict, total=False):
    """The options as keywords of `calibrate`, which says what each means."""

    model: Model
    weighting: Weighting
    threshold_mm: float | Literal["auto"]
    sigma_px: float | None
    sigma_mm: float | None
    confidence: float
    max_samples: int
    exhaustive_samples: int
    seed: int
    scale_mm_per_px: float | None
    fit_split: str | None
    test_split: str | None
    image_size_px: tuple[int, ...] | None
    tolerance_mm: float
    scanner_mm_per_px: float | tuple[float, float] | None
    marker_above_image: bool
    expected_rotation: ArrayLike | None
    latency: Literal["estimate"] | None
    probe_radius_mm: float | None
    sound_speed_m_s: float | Literal["estimate"] | None
    assumed_sound_speed_m_s: float
    probe_face_px: tuple[float, ...] | None
    targets: Sequence[Line | Plane | Point | Unplaced] | None


@dataclass(frozen=True)
class Options(RegistrationOptions):
    """How to calibrate; `calibrate` says what each option means.

    Raises:
        InputError: an option means nothing; the sentence names it and what arrived.
    """

    fit_split: str | None = None
    test_split: str | None = None
    image_size_px: tuple[int, ...] | None = None
    tolerance_mm: float = 2.0
    scanner_mm_per_px: float | tuple[float, float] | None = None
    marker_above_image: bool = False
    expected_rotation: tuple[tuple[float, ...], ...] | None = None
    latency: Literal["estimate"] | None = None
    probe_radius_mm: float | None = None
    sound_speed_m_s: float | Literal["estimate"] | None = None
    assumed_sound_speed_m_s: float = ASSUMED_M_S
    probe_face_px: tuple[float, ...] | None = None
    targets: tuple[Line | Plane | Point | Unplaced, ...] | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.threshold_mm != "auto":  # a row that is anywhere is no sighting
            positive_number("threshold_mm", self.threshold_mm)
        self._keep("tolerance_mm", positive_number("tolerance_mm", self.tolerance_mm))
        for name in ("fit_split", "test_split"):
            self._keep(name, _text(name, getattr(self, name)))
        if self.test_split is not None and self.test_split == self.fit_split:
            raise InputError(
                f"fit_split and test_split are both {self.fit_split!r}; held-out rows must not be fitted"
            )
        if self.image_size_px is not None:
            self._keep("image_size_px", _size(self.image_size_px))
        if self.scanner_mm_per_px is not None:
            self._keep("scanner_mm_per_px", _scanner(self.scanner_mm_per_px))
        self._keep("marker_above_image", true_or_false("marker_above_image", self.marker_above_image))
        if self.expected_rotation is not None:
            self._keep("expected_rotation", _rotation(self.expected_rotation))
        if self.latency is not None:
            self._keep("latency", one_of("latency", self.latency, ("estimate",)))
        if self.targets is not None:
            self._keep("targets", _targets(self.targets))
        of_sound = [getattr(self, name) for name in OF_SOUND]
        for name, value in checked_sound(self.model, *of_sound).items():
            self._keep(name, value)

    def without_sound(self) -> Self:
        """The same for rows whose places are as at the speed of sound that the scanner assumes."""
        return replace(self, probe_radius_mm=None, sound_speed_m_s=None, probe_face_px=None)

    def resolved(self, threshold_mm: float) -> Self:
        """The same with the threshold in mm that "auto" came to."""
        return replace(self, threshold_mm=threshold_mm) if self.threshold_mm == "auto" else self

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """The options in a calibration's file, which holds those of its recording, too; defaults for the absent.

        Raises:
            InputError: a value is none that an option has.
        """
        return cls.of(**{name: value for name, value in record.items() if name in cls.__dataclass_fields__})

    def record(self) -> dict[str, Any]:
        """The options as a calibration's file holds them: those that every calibration has had, and what was told."""
        return {
            name: _plain(value)
            for name, field in self.__dataclass_fields__.items()
            if name in RECORDED or (name not in UNRECORDED and getattr(self, name) != field.default)
            for value in [getattr(self, name)]
        }


def kept_options(asked: Options, used: Options) -> dict[str, Any]:
    """The options as a calibration's file keeps them: those used, and what was asked where that was no number."""
    told = {"threshold_asked": asked.threshold_mm} if asked.threshold_mm != used.threshold_mm else {}
    return used.record() | told


# Of expected directions: what a person reads off a probe may be that far from a rotation.
ROUGHLY = 0.5
# Of version 1 of the file.
RECORDED = (
    *("model", "weighting", "threshold_mm", "sigma_px", "sigma_mm", "fit_split", "test_split"),
    *("image_size_px", "tolerance_mm", "max_samples", "seed"),
)


# What a calibration says of them itself.
UNRECORDED = ("targets",)


def _targets(value: Any) -> tuple[Line | Plane | Point | Unplaced, ...]:
    require("targets", value, Sequence, "points, lines and planes, or those whose place is unknown")
    for one in value:
        if not isinstance(one, (Line, Plane, Point, Unplaced)):
            raise InputError(f"targets must be points, lines and planes, or Unplaced; got {one!r}"[:200])
    check_lines("targets", value, "targets")
    return tuple(value)


def _text(name: str, value: Any) -> str | None:
    if value is not None and not isinstance(value, str):
        raise InputError(f"{name} must be the name of a split; got {value!r}")
    return None if value is None else str(value)


def _size(value: Any) -> tuple[int, ...]:
    try:
        size = tuple(positive_number("image_size_px", number) for number in value)
    except (TypeError, InputError):
        size = ()
    if len(size) not in (2, 3) or any(number != int(number) or number >= FURTHEST for number in size):
        raise InputError(
            f"image_size_px must be two or three positive whole numbers below {FURTHEST:g}; got {str(value)[:60]}"
        )
    return tuple(int(number) for number in size)


def _scanner(value: Any) -> float | tuple[float, float]:
    try:
        said = [
            positive_number("scanner_mm_per_px", number)
            for number in np.atleast_1d(np.asarray(value, dtype=object))
        ]
    except InputError:
        said = []
    if len(said) not in (1, 2):
        raise InputError(
            f"scanner_mm_per_px must be positive, one number or one along u and one along v; got {str(value)[:60]}"
        )
    return said[0] if np.ndim(value) == 0 else (said[0], said[-1])


def _rotation(value: Any) -> tuple[tuple[float, ...], ...]:
    try:
        directions = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        directions = np.empty(0)
    if directions.shape != (3, 3) or not np.all(np.isfinite(directions)):
        raise InputError(
            "expected_rotation must be the directions of u, v and normal, shape (3, 3), as columns; got "
            f"shape {directions.shape}"
        )
    if not np.abs(directions.T @ directions - np.eye(3)).max() < ROUGHLY:
        raise InputError(
            "expected_rotation must be directions of about unit length, about at right angles; got columns of lengths "
            f"{np.round(np.linalg.norm(directions, axis=0), 3).tolist()}"
        )
    if np.linalg.det(directions) < 0:
        raise InputError(
            "expected_rotation must be a rotation; got left-handed directions: the third column is u x v, turn it round"
        )
    return tuple(map(tuple, directions.tolist()))


def _plain(value: Any) -> Any:
    return [_plain(part) for part in value] if isinstance(value, tuple) else value
