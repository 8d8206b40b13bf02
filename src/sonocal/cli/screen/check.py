"""What the command line shows of a check, and of a log of them."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from sonocal.cli.screen.parts import print_findings
from sonocal.cli.screen.tables import NumberTable
from sonocal.validation import Check
from sonocal.validation.check_log import CheckLog

__all__ = ["check_record", "print_check", "print_check_log"]

# What programs are told of a check.
TOLD = (
    *("verdict", "rows", "tolerance_mm", "moved_mm", "turned_deg", "scale_change", "p_value", "power_mean"),
    *("power_least", "visible_mm", "tangent", "covariance", "freedom", "diagnostics"),
)
SAID = {
    "holds": ("The calibration holds.", "green"),
    "changed": ("The calibration has changed.", "red"),
    "cannot tell": ("This sweep cannot tell.", "yellow"),
}


def print_check(console: Console, check: Check) -> None:
    """The verdict with what the sweep could have shown, then the findings."""
    words, colour = SAID[check.verdict]
    text = Text(words + " ", style=f"bold {colour}")
    text.append(_seen(check), style="default not bold")
    console.print(text)
    print_findings(console, check.diagnostics)


def _seen(check: Check) -> str:
    least = "none" if check.visible_mm == float("inf") else f"{check.visible_mm:.1f} mm"
    return (
        f"By {check.rows} sightings the image moved by {check.moved_mm:.2f} mm rms, turned by {check.turned_deg:.2f} "
        f"deg and grew by {100 * check.scale_change:+.2f} % (p = {check.p_value:.2g}). Of knocks of "
        f"{check.tolerance_mm:g} mm such a sweep shows {100 * check.power_mean:.0f} %; of those that go the way it "
        f"sees least {100 * check.power_least:.0f} %. Seen whichever way they go (80 %): {least}."
    )


def check_record(check: Check) -> dict[str, object]:
    """A check for programs."""
    return {name: getattr(check, name) for name in TOLD}


def print_check_log(console: Console, log: CheckLog) -> None:
    """A row a check, the last one first."""
    table = NumberTable(log.name, "verdict", "moved, mm", "turned, deg", "p", "power", first="checked")
    for one in log.checks[::-1]:
        numbers = (
            f"{one.moved_mm:.2f}",
            f"{one.turned_deg:.2f}",
            f"{one.p_value:.2g}",
            f"{100 * one.power_mean:.0f} %",
        )
        table.add_row(one.checked[:16].replace("T", " "), one.verdict, *numbers)
    console.print(table)
    if log.damaged:
        console.print(Text(f"Lines that are no checks: {', '.join(map(str, log.damaged))}"))
