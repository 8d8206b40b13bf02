"""How to calibrate: every option, checked once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sonocal.errors import InputError
from sonocal.registration.fit import Model, Weighting
from sonocal.registration.options import Options as RegistrationOptions

__all__ = ["MODELS", "WEIGHTINGS", "check_options"]

MODELS: tuple[Model, ...] = ("similarity", "anisotropic")


WEIGHTINGS: tuple[Weighting, ...] = ("likelihood", "geometric")


def check_options(
    *,
    model: str,
    weighting: str,
    threshold_mm: float | str,
    tolerance_mm: float,
    max_samples: int,
    sigma_px: float | None,
    sigma_mm: float | None,
) -> None:
    """Refuse options that mean nothing."""
    for name, choice, choices in (("model", model, MODELS), ("weighting", weighting, WEIGHTINGS)):
        if choice not in choices:
            raise InputError(f"{name} must be one of {', '.join(choices)}; got {choice!r}")
    numbers: dict[str, Any] = {"tolerance_mm": tolerance_mm, "max_samples": max_samples}
    numbers |= {"threshold_mm": threshold_mm} if threshold_mm != "auto" else {}
    numbers |= {
        name: value for name, value in (("sigma_px", sigma_px), ("sigma_mm", sigma_mm)) if value is not None
    }
    for name, value in numbers.items():
        if not (isinstance(value, (int, float)) and np.isfinite(value) and value > 0):
            raise InputError(f"{name} must be a positive number; got {value}")


@dataclass(frozen=True)
class Options(RegistrationOptions):
    """How to calibrate."""

    fit_split: str | None = None
    test_split: str | None = None
    image_size_px: tuple[int, ...] | None = None
    tolerance_mm: float = 2.0
