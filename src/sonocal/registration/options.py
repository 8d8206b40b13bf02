"""How to register: every option, checked once, and handed on whole."""

from __future__ import annotations

from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import lru_cache
from math import inf, nan
from numbers import Real
from typing import Any, Literal, Self

import numpy as np

from sonocal import _core
from sonocal.errors import InputError

__all__ = [
    "Model",
    "Options",
    "Weighting",
    "one_of",
    "positive_number",
    "scale_count",
    "true_or_false",
    "unknowns",
    "whole_number",
]

Model = Literal["similarity", "anisotropic", "rigid"]
Weighting = Literal["likelihood", "geometric"]

CHOICES = {"model": ("similarity", "anisotropic", "rigid"), "weighting": ("likelihood", "geometric")}
MOST_SAMPLES = 2**30
MOST_COMBINATIONS = 2**20
# Whose products with three such numbers are finite still: what the core takes.
LARGEST = 1e60


@dataclass(frozen=True)
class Options:
    """How to find a transform; `registration.robust.fit_point_lines` says what each option does.

    Attributes:
        model: one scale; one along every axis of the image; or "rigid", a scale that is known.
        weighting: what the last refinement minimises.
        threshold_mm: rows within this distance agree, in units of the target; "auto": from the noise; infinite: all.
        sigma_px: noise of a point along every axis, px, where known; a factor of the rows' own column.
        sigma_mm: noise of a segment's end point along every axis, mm, where known; likewise.
        confidence: of having drawn a sample without outliers.
        max_samples: random samples at the most.
        exhaustive_samples: up to this many combinations are all tried.
        seed: of the random samples.
        scale_mm_per_px: where it is known, which makes the model "rigid".

    Raises:
        InputError: an option means nothing; the sentence names it and what arrived.
    """

    model: Model = "similarity"
    weighting: Weighting = "likelihood"
    threshold_mm: float | Literal["auto"] = 5.0
    sigma_px: float | None = None
    sigma_mm: float | None = None
    confidence: float = 0.9999
    max_samples: int = 10_000
    exhaustive_samples: int = 200
    seed: int = 0
    scale_mm_per_px: float | None = None

    @classmethod
    def of(cls, **keywords: Any) -> Self:
        """The options with those names.

        Raises:
            InputError: there is no option of a name, or its value means nothing.
        """
        names = list(cls.__dataclass_fields__) if keywords else []
        for name in keywords:
            if name not in names:
                near = get_close_matches(name, names, 1)
                hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(names)}"
                raise InputError(f"there is no option {name!r}; {hint}")
        return cls(**keywords)

    @classmethod
    def known(cls, *values: Any) -> Self:
        """The options in their order; those that were asked for before are not checked again.

        Whoever registers thousands of times does so with few options, and their checks take as long as a
        tenth of a fit.

        Raises:
            InputError: a value means nothing.
        """
        try:
            return cls._known(*values)
        except TypeError:  # a value that cannot be a key, which is no sound one either
            return cls(*values)

    @classmethod
    @lru_cache(maxsize=64, typed=True)
    def _known(cls, *values: Any) -> Self:
        return cls(*values)

    def __post_init__(self) -> None:
        for name, choices in CHOICES.items():
            self._keep(name, one_of(name, getattr(self, name), choices))
        if isinstance(self.threshold_mm, str) and self.threshold_mm == "auto":
            self._keep("threshold_mm", "auto")  # of the very type, whatever kind of text it came as
        else:
            self._keep("threshold_mm", positive_number("threshold_mm", self.threshold_mm, or_infinite=True))
        for name in ("sigma_px", "sigma_mm"):
            if (value := getattr(self, name)) is not None:
                self._keep(name, positive_number(name, value))
        self._keep("confidence", positive_number("confidence", self.confidence))
        if self.confidence >= 1:
            raise InputError(f"confidence must be below 1; got {self.confidence}")
        for name, least, most in (
            ("max_samples", 1, MOST_SAMPLES),
            ("exhaustive_samples", 0, MOST_COMBINATIONS),
            ("seed", 0, 2**64 - 1),
        ):
            self._keep(name, whole_number(name, getattr(self, name), least, most))
        if self.scale_mm_per_px is not None or self.model == "rigid":
            self._keep_scale()

    def _keep_scale(self) -> None:
        if self.scale_mm_per_px is None:
            raise InputError(
                "the rigid model is that of a known scale; give it as scale_mm_per_px, such as 0.24"
            )
        self._keep("scale_mm_per_px", positive_number("scale_mm_per_px", self.scale_mm_per_px))
        if self.model == "anisotropic":
            raise InputError(
                "scale_mm_per_px says that the scale is known, one for all axes, and the anisotropic model that each "
                "has its own; leave out one of them"
            )
        self._keep("model", "rigid")

    def of_model(self, model: Model) -> Self:
        """The same with a model of which no scale is known."""
        return replace(self, model=model, scale_mm_per_px=None)

    def to_core(self, level_px: float, level_mm: float) -> _core.Options:
        """The options as the core takes them, with noise levels of 0 where they are to be estimated."""
        return _core.Options(
            model=self.model,
            weighting=self.weighting,
            threshold=0.0 if self.threshold_mm == "auto" else self.threshold_mm,
            level_px=level_px,
            level_mm=level_mm,
            confidence=self.confidence,
            max_samples=self.max_samples,
            exhaustive_samples=self.exhaustive_samples,
            seed=self.seed,
            scale=self.scale_mm_per_px or 0.0,
        )

    def _keep(self, name: str, value: object) -> None:
        if getattr(self, name) is not value:
            object.__setattr__(self, name, value)


def scale_count(model: Model, dimension: int) -> int:
    """How many scales of a 2D or 3D image the model has among its unknowns."""
    return {"rigid": 0, "similarity": 1}.get(model, dimension)


def unknowns(model: Model, dimension: int) -> int:
    """How many numbers the tangent has: a turn, a shift, the logarithms of the scales."""
    return 6 + scale_count(model, dimension)


def one_of(name: str, value: Any, choices: tuple[str, ...]) -> str:
    """A choice as plain text.

    Raises:
        InputError: it is none of them.
    """
    if not isinstance(value, str) or value not in choices:
        raise InputError(f"{name} must be one of {', '.join(choices)}; got {value!r}")
    return str(value)


def positive_number(name: str, value: Any, *, or_infinite: bool = False) -> float:
    """A positive finite number as a float, whatever type of number it came as; True is none.

    Raises:
        InputError: it is no such number.
    """
    if type(value) is float and 0 < value <= LARGEST:  # checked before: no need to ask more
        return value
    number = _as_float(value)
    if not (0 < number <= LARGEST or (or_infinite and number == inf)):
        limit = f" up to {LARGEST:g}" if LARGEST < number < inf else ""
        raise InputError(f"{name} must be a positive number{limit}; got {_shown(value)}")
    return number


def _as_float(value: Any) -> float:
    """A number of whatever type as a float; NaN for what is none, or too large to be one."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return nan
    try:
        return float(value)
    except OverflowError:
        return nan


def whole_number(name: str, value: Any, least: int, most: int) -> int:
    """A whole number between two as an int, whatever type of number it came as; True is none.

    Raises:
        InputError: it is no such number.
    """
    if type(value) is int and least <= value <= most:
        return value
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        raise InputError(f"{name} must be a whole number from {least} to {most}; got {_shown(value)}")
    return int(value)


def true_or_false(name: str, value: Any) -> bool:
    """A truth, also NumPy's; text and numbers are none.

    Raises:
        InputError: it is neither True nor False.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} must be True or False; got {value!r}"[:200])
    return bool(value)


def _shown(value: Any) -> str:
    """What arrived, for a message: that a number is text cannot be seen otherwise."""
    return f"the text {value[:60]!r}" if isinstance(value, str) else str(value)[:60]
