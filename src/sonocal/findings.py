"""What a user should know about a recording before using it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Diagnostic"]


@dataclass(frozen=True)
class Diagnostic:
    """One finding.

    Attributes:
        code: short name, for programs.
        severity: "warning" (read before use) or "info".
        message: what was found, with numbers and units.
        advice: what to do about it.
    """

    code: str
    severity: Literal["warning", "info"]
    message: str
    advice: str
