"""What a user should know about a recording or a calibration before using it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

__all__ = ["Diagnostic", "warnings_first"]


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


def warnings_first(findings: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """The findings in their order, those to read before use before the others."""
    return tuple(sorted(findings, key=lambda finding: finding.severity != "warning"))
