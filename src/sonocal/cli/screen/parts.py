"""What every screen is made of: findings and the verdict."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import zip_longest

from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from sonocal.calibration import Calibration
from sonocal.findings import Diagnostic, begun, warnings_first
from sonocal.validation import CANNOT_SHOW, Verdict, cannot_show

__all__ = ["finding", "print_findings", "standing", "verdict_text"]

COLOURS = {"use": "green", "care": "yellow", "stop": "red"}


def verdict_text(verdict: Verdict) -> Text:
    """The verdict and what to expect; the findings beside it are its reasons."""
    text = Text(verdict.headline + ". ", style=f"bold {COLOURS[verdict.level]}")
    text.append(verdict.expectation, style="default not bold")
    return text


def finding(found: Diagnostic, *, advised: bool = True) -> RenderableType:
    """What was found, and what to do, unless that is said elsewhere."""
    warning = found.severity == "warning"
    head = Text("warning " if warning else "note ", style="bold yellow" if warning else "bold cyan")
    head.append(found.code, style="dim")
    body = Text(begun(found.message) + ".")
    advice = Text("What to do: " + found.advice + ".", style="italic")
    said = (body, advice) if advised else (body,)
    return Group(head, *(Padding(text, (0, 0, 0, 2), expand=False) for text in said))


def standing(calibration: Calibration) -> RenderableType:
    """What no scan shows, with what to compare."""
    sentences = [Padding(Text(one), (0, 0, 0, 2), expand=False) for one in cannot_show(calibration)]
    return Group(Text(f"{CANNOT_SHOW}:", style="bold"), *sentences)


def print_findings(console: Console, findings: Iterable[Diagnostic], severity: str | None = None) -> None:
    """The findings of one severity, or all, in reading order; of neighbours with one remedy, the last says it."""
    wanted = [one for one in findings if severity in (None, one.severity)]
    ordered = warnings_first(wanted)
    for found, following in zip_longest(ordered, ordered[1:]):
        console.print(finding(found, advised=following is None or following.advice != found.advice))
