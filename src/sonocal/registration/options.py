"""How to register: every option, checked once."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass, fields
from typing import Any, Literal, Self

from sonocal.errors import InputError
from sonocal.registration.fit import Model, Weighting

__all__ = ["Options"]

CHOICES = {"model": ("similarity", "anisotropic"), "weighting": ("likelihood", "geometric")}


@dataclass(frozen=True)
class Options:
    """Options of a registration."""

    model: Model = "similarity"
    weighting: Weighting = "likelihood"
    threshold_mm: float | Literal["auto"] = 5.0
    sigma_px: float | None = None
    sigma_mm: float | None = None
    confidence: float = 0.9999
    max_samples: int = 10_000
    exhaustive_samples: int = 200
    seed: int = 0

    @classmethod
    def of(cls, **keywords: Any) -> Self:
        names = [field.name for field in fields(cls)]
        for name in keywords:
            if name not in names:
                near = difflib.get_close_matches(name, names, 1)
                raise InputError(
                    f"there is no option {name!r}" + (f"; did you mean {near[0]!r}?" if near else "")
                )
        return cls(**keywords)

    def __post_init__(self) -> None:
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                raise InputError(f"{name} must be one of {', '.join(choices)}; got {getattr(self, name)!r}")
        for name in ("threshold_mm", "sigma_px", "sigma_mm", "max_samples"):
            value = getattr(self, name)
            if value is None and name.startswith("sigma") or value == "auto" and name == "threshold_mm":
                continue
            if isinstance(value, bool) or not (
                isinstance(value, (int, float)) and math.isfinite(value) and value > 0
            ):
                raise InputError(f"{name} must be a positive number; got {value}")
