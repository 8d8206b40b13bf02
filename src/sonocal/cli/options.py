"""What several commands share: options, parameter types, the bar of progress."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.piped import Readable

if TYPE_CHECKING:
    from rich.console import Console

__all__ = [
    "ANGLES",
    "CENTRE",
    "COUNT",
    "FILE",
    "INVALID",
    "JSON",
    "LATENCY",
    "LATENCY_OR_ESTIMATE",
    "LINES",
    "MARKERS",
    "MASK",
    "NO_REPORT",
    "POSES",
    "PROBE",
    "SCANNER",
    "THRESHOLD",
    "WRITTEN",
    "NumberOr",
    "Scale",
    "Size",
    "console",
    "given",
    "output_folder",
    "progress",
    "seed",
    "typed",
]

FILE = Readable()
WRITTEN = click.Path(path_type=Path)


class Size(click.ParamType[tuple[int, ...]]):
    """WIDTHxHEIGHT or WIDTHxHEIGHTxDEPTH, px."""

    name = "WxH[xD]"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, ...]:
        """The numbers of a size."""
        parts = str(value).lower().split("x")
        if len(parts) not in (2, 3) or not all(part.isdigit() and int(part) > 0 for part in parts):
            self.fail(f"{value!r} is not a size such as 640x480", param, ctx)
        return tuple(int(part) for part in parts)


class Scale(click.ParamType[float | tuple[float, float]]):
    """Millimetres per px, one number or one along u and one along v."""

    name = "MM[,MM]"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float | tuple[float, float]:
        """The number, or both."""
        try:
            numbers = [float(part) for part in str(value).split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (1, 2) or not all(0 < number < math.inf for number in numbers):
            self.fail(
                f"{value!r} is not a positive number such as 0.24, or two such as 0.24,0.25", param, ctx
            )
        return numbers[0] if len(numbers) == 1 else (numbers[0], numbers[1])


class NumberOr(click.ParamType[float | str]):
    """A number of some unit, or a word that has it found.

    Args:
        word: such as "auto".
        unit: of the number, in words.
        name: of the option's value in help.
    """

    def __init__(self, word: str, unit: str, name: str) -> None:
        self.word, self.unit, self.name = word, unit, name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | str:
        """The number, or the word."""
        if value == self.word:
            return self.word
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number of {self.unit} nor {self.word}", param, ctx)


THRESHOLD = NumberOr("auto", "millimetres", "MM|auto")


LINES = click.option(
    "--lines",
    "--targets",
    "lines",
    type=FILE,
    help="The needle or wires, cross-wires, walls: needle.toml or a PLUS device set (XML). Of a table: what its rows "
    "are of, where they give poses alone.",
)
POSES = click.option(
    "--poses",
    type=FILE,
    multiple=True,
    help="The tracker's own recording, beside a video or a folder of images; again for each further file.",
)
ANGLES = click.option(
    "--angles",
    metavar="ORDER",
    help="What three angles of a pose mean where their file does not say: ZYX or another order (capitals: about the "
    "tool's own axes; small letters: about the tracker's), or vector.",
)
MARKERS = click.option(
    "--markers",
    type=FILE,
    help="Where markers are in their tools' frames: points (.toml), for recordings of markers (C3D, Vicon).",
)
PROBE = click.option("--probe", default="Probe", show_default=True, help="What the probe's marker is called.")
LATENCY = click.option(
    "--latency",
    "latency_s",
    type=float,
    default=0.0,
    show_default=True,
    help="How much later the tracker stamps an instant than the images do, s.",
)
LATENCY_OR_ESTIMATE = click.option(
    "--latency",
    "latency_s",
    type=NumberOr("estimate", "seconds", "S|estimate"),
    metavar="S|estimate",
    default=0.0,
    show_default=True,
    help='How much later the tracker stamps an instant than the images do, s; "estimate": fitted, too, and undone.',
)
INVALID = click.option(
    "--on-invalid",
    type=click.Choice(["raise", "skip"]),
    default="raise",
    show_default=True,
    help="What to do with poses that are not rigid.",
)
COUNT = click.option(
    "--count", type=click.IntRange(1), default=5, show_default=True, help="Candidates an image."
)
CENTRE = click.option(
    "--centre",
    type=click.Choice(["head", "mass"]),
    default="head",
    show_default=True,
    help="Of a bright spot: its first echo (needles), or all of it (wires, as PLUS does).",
)
MASK = click.option(
    "--mask",
    type=FILE,
    help="Image of the recording's size, not black where to look.  [default: found from the recording]",
)
SCANNER = click.option(
    "--scanner-mm-per-px", type=Scale(), help="What the scanner says, to compare; or along u and along v."
)
NO_REPORT = click.option(
    "--no-report", "report", is_flag=True, flag_value=False, default=True, help="Write no page (HTML)."
)
JSON = click.option(
    "--json", "as_json", is_flag=True, help="Print the result as JSON on stdout instead of tables."
)


def seed(of: str) -> Callable[[Any], Any]:
    """The option --seed."""
    return click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help=f"Of {of}.")


def output_folder(default: str, holds: str) -> Callable[[Any], Any]:
    """The option -o of a command that writes several files."""
    return click.option(
        "-o",
        "--output",
        type=WRITTEN,
        default=Path(default),
        show_default=True,
        help=f"Folder for {holds}; made if absent.",
    )


def typed(names: tuple[str, ...]) -> list[str]:
    """The options, of some, that stand on the command line."""
    context, there = click.get_current_context(), click.core.ParameterSource.COMMANDLINE
    return [
        option.opts[0]
        for option in context.command.params
        if option.name in names and context.get_parameter_source(option.name) is there
    ]


def given(names: tuple[str, ...], values: Mapping[str, Any]) -> dict[str, Any]:
    """The values of those options, of some, that stand on the command line: others are left to what suits the data."""
    context, there = click.get_current_context(), click.core.ParameterSource.COMMANDLINE
    return {name: values[name] for name in names if context.get_parameter_source(name) is there}


def console() -> Console:
    """Where results are printed."""
    from sonocal.cli.screen.terminal import Terminal

    return Terminal(highlight=False)


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr, so that stdout stays the result's; none, and no time for it, where nobody looks."""
    from rich.console import Console
    from rich.progress import Progress

    errors = Console(stderr=True)
    if not errors.is_terminal:
        yield lambda done, total: None
        return
    with Progress(console=errors, transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
