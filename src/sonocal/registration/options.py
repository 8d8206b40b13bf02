"""How to register: every option, checked once."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, fields
from typing import Any, Literal, Self

import numpy as np

from sonocal.errors import InputError
from sonocal.registration.fit import Model, Weighting

__all__ = ["Options"]

CHOICES = {"model": ("similarity", "anisotropic"), "weighting": ("likelihood", "geometric")}


@dataclass(frozen=True)
class Options:
    """How to register points and lines; `fit_point_lines` says what each option means.

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

    def __post_init__(self) -> None:
        for name, choices in CHOICES.items():
            value = getattr(self, name)
            if not (isinstance(value, str) and value in choices):
                raise InputError(f"{name} must be one of {', '.join(choices)}; got {value!r}")
            object.__setattr__(self, name, str(value))
        for name in ("threshold_mm", "sigma_px", "sigma_mm", "confidence"):
            value = getattr(self, name)
            if value is not None and not (
                isinstance(value, str) and (name, value) == ("threshold_mm", "auto")
            ):
                object.__setattr__(self, name, float(_positive(name, value)))
        for name in ("max_samples", "exhaustive_samples", "seed"):
            object.__setattr__(self, name, _whole(name, getattr(self, name)))

    @classmethod
    def of(cls, **keywords: Any) -> Self:
        """The options of some keywords, of which each must be one."""
        names = [field.name for field in fields(cls)]
        for name in keywords:
            if name not in names:
                near = difflib.get_close_matches(name, names, 1)
                also = f"; did you mean {near[0]!r}?" if near else f"; there are {', '.join(names)}"
                raise InputError(f"there is no option {name!r}{also}")
        return cls(**keywords)


def _positive(name: str, value: Any) -> Any:
    number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    if not (number and np.isfinite(value) and value > 0):
        raise InputError(f"{name} must be a positive number; got {value}")
    return value


def _whole(name: str, value: Any) -> int:
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not (whole and value >= (name == "max_samples")):
        raise InputError(f"{name} must be a positive number; got {value}")
    return int(value)
