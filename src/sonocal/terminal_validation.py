"""What `sonocal validate` shows: the verdict, the numbers with their meaning, the comparison, the findings."""

from __future__ import annotations

import math

from rich import box
from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from sonocal.calibration import Calibration
from sonocal.findings import Diagnostic
from sonocal.report.verdict import Verdict, give_verdict
from sonocal.validation import Comparison, Quantity, Validation

__all__ = ["print_validation"]

COLOURS = {"use": "green", "care": "yellow", "stop": "red"}


def print_validation(
    console: Console, calibration: Calibration, validation: Validation, comparison: Comparison | None = None
) -> None:
    """Verdict, numbers, comparison, findings."""
    console.print(_verdict(give_verdict(calibration, validation)))
    console.print()
    if validation.quantities:
        console.print(_numbers(validation))
        console.print(Text("What they are:", style="bold"))
        for quantity in validation.quantities:
            console.print(_definition(quantity))
    if comparison is not None:
        console.print()
        console.print(_comparison(comparison))
    findings = sorted(
        [*calibration.diagnostics, *validation.diagnostics], key=lambda finding: finding.severity != "warning"
    )
    for finding in findings:
        console.print(_finding(finding))


def _verdict(verdict: Verdict) -> Text:
    text = Text(verdict.headline + ". ", style=f"bold {COLOURS[verdict.level]}")
    text.append(verdict.expectation, style="default not bold")
    return text


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("")
    for column in columns:
        table.add_column(column, justify="right")
    return table


def _numbers(validation: Validation) -> Table:
    table = _table(f"Errors on {validation.source}, mm", "value", "95 % interval", "spread", "from")
    for q in validation.quantities:
        interval = "unknown" if math.isnan(q.low_mm) else f"{q.low_mm:.2f} to {q.high_mm:.2f}"
        table.add_row(
            q.title, f"{q.value_mm:.3f}", interval, f"{q.spread_mm:.2f}", f"{q.count} in {q.units} {q.unit}"
        )
    return table


def _definition(quantity: Quantity) -> RenderableType:
    return Padding(Text(f"{quantity.title}: {quantity.definition}."), (0, 0, 0, 2), expand=False)


def _comparison(comparison: Comparison) -> RenderableType:
    table = _table("Against the other calibration, mm", "apart", "uncertainty allows (95 %)")
    for place, distance, allowed in comparison.rows:
        table.add_row(f"at {place} px", f"{distance:.2f}", f"{allowed:.2f}")
    shared = (
        " Both were fitted to the same rows: their errors go together." if comparison.shared_input else ""
    )
    return Group(table, Text(comparison.sentence + shared))


def _finding(finding: Diagnostic) -> RenderableType:
    warning = finding.severity == "warning"
    head = Text("warning " if warning else "note ", style="bold yellow" if warning else "bold cyan")
    head.append(finding.code, style="dim")
    body = Text(finding.message[0].upper() + finding.message[1:] + ".")
    advice = Text("What to do: " + finding.advice + ".", style="italic")
    return Group(head, Padding(body, (0, 0, 0, 2), expand=False), Padding(advice, (0, 0, 0, 2), expand=False))
