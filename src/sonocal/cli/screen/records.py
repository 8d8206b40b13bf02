"""What `sonocal info` shows of files that sonocal wrote for people, or of what it simulated."""

from __future__ import annotations

from rich.console import Console, Group
from rich.text import Text

from sonocal.cli.screen.parts import COLOURS
from sonocal.cli.screen.tables import MatrixRows
from sonocal.report.page_file import Page
from sonocal.simulation.truth_file import KnownTruth

__all__ = ["print_page", "print_truth_file"]

MATRIX = "probe_from_image (PLUS: ImageToProbe): mm in the probe marker's frame from px"


def print_truth_file(console: Console, found: KnownTruth) -> None:
    """What a simulated sweep was made with."""
    console.print(Text(f"{found.name}: truth of a simulated sweep", style="bold"))
    seen, images = int(found.visible.sum()), len(found.visible)
    console.print(f"The needle shows in {seen} of {images} images.")
    console.print(f"The tracker's stamps are {found.latency_s:g} s later than the images'.")
    console.print(Group(Text(MATRIX, style="bold"), MatrixRows(found.probe_from_image)))
    if found.options:
        said = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in found.options.items())
        console.print(Text(f"Made with: {said}"))


def print_page(console: Console, found: Page) -> None:
    """The verdict of a page, and its matrix."""
    console.print(Text(f"{found.name}: page of sonocal to open in a browser", style="bold"))
    if found.title:
        console.print(Text(found.title))
    if found.made:
        source = f", from {found.source}" if found.source else ""
        console.print(Text(f"Made {found.made}{source}"))
    if found.headline:
        verdict = Text(found.headline + ". ", style=f"bold {COLOURS.get(found.level, 'default')}")
        console.print(verdict.append(found.expectation, style="default not bold"))
    if found.codes:
        console.print(Text(f"Because of: {', '.join(found.codes)}"))
    if found.probe_from_image is not None:
        console.print(Group(Text(MATRIX, style="bold"), MatrixRows(found.probe_from_image)))
