"""What every screen is made of: findings and the verdict."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from sonocal.calibration import Calibration
from sonocal.findings import Diagnostic, warnings_first
from sonocal.validation import CANNOT_SHOW, Verdict, cannot_show

__all__ = ["finding", "print_findings", "standing", "verdict_text"]

COLOURS = {"use": "green", "care": "yellow", "stop": "red"}


def verdict_text(verdict: Verdict) -> Text:
    """The verdict and what to expect; the findings beside it are its reasons."""
    text = Text(verdict.headline + ". ", style=f"bold {COLOURS[verdict.level]}")
    text.append(verdict.expectation, style="default not bold")
    return text


def finding(found: Diagnostic) -> RenderableType:
    """What was found, and what to do."""
    warning = found.severity == "warning"
    head = Text("warning " if warning else "note ", style="bold yellow" if warning else "bold cyan")
    head.append(found.code, style="dim")
    body = Text(found.message[0].upper() + found.message[1:] + ".")
    advice = Text("What to do: " + found.advice + ".", style="italic")
    return Group(head, Padding(body, (0, 0, 0, 2), expand=False), Padding(advice, (0, 0, 0, 2), expand=False))


def standing(calibration: Calibration) -> RenderableType:
    """What no scan shows, with what to compare."""
    sentences = [Padding(Text(one), (0, 0, 0, 2), expand=False) for one in cannot_show(calibration)]
    return Group(Text(f"{CANNOT_SHOW}:", style="bold"), *sentences)


def print_findings(console: Console, findings: Iterable[Diagnostic], severity: str | None = None) -> None:
    """The findings of one severity, or all, in the order in which they are read everywhere."""
    for found in warnings_first(findings):
        if severity in (None, found.severity):
            console.print(finding(found))
