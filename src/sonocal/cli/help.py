"""Help that is whole at any width: options in groups, then examples; nothing is cut."""

from __future__ import annotations

import inspect
import re
import shutil
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import click

__all__ = [
    "COMPLETION",
    "DETECTING",
    "READING",
    "SET_UP",
    "Command",
    "Commands",
    "Context",
    "Formatter",
    "Groups",
    "command",
]

Groups = Mapping[str, Sequence[str]]
"""A heading, and the names of the parameters below it."""

# Groups that several commands have.
READING = ("poses", "angles", "markers", "probe", "latency_s", "on_invalid")
DETECTING = ("count", "centre", "mask")
SET_UP = ("scanner_mm_per_px", "marker_above_image", "expected", "accept_units")

# Lines longer than this are hard to follow; below the least, words stand alone.
WIDEST, NARROWEST = 100, 24
# A second column narrower than this is a ladder of words: what it says stands below the first, then.
LEAST_COLUMN = 26
OTHERS = "Help"
# Between words that stay on one line.
BOUND = "\0"
# Lines for the start-up files of bash, zsh and fish.
COMPLETION = (
    'eval "$(_SONOCAL_COMPLETE=bash_source sonocal)"',
    'eval "$(_SONOCAL_COMPLETE=zsh_source sonocal)"',
    "_SONOCAL_COMPLETE=fish_source sonocal | source",
)


class Formatter(click.HelpFormatter):
    """Text at the terminal's width, whatever it is: words are whole, and what is long goes on below."""

    def __init__(
        self, indent_increment: int = 2, width: int | None = None, max_width: int | None = None
    ) -> None:
        columns = width or shutil.get_terminal_size().columns
        super().__init__(indent_increment, max(min(columns, max_width or WIDEST) - 1, NARROWEST))

    def write_text(self, text: str) -> None:
        r"""Paragraphs; one that begins with \b is a list of terms, each two spaces or more before what it means."""
        for i, paragraph in enumerate(text.split("\n\n")):
            if i:
                self.write_paragraph()
            first, _, rest = paragraph.partition("\n")
            if first.strip() == "\b":
                self.write_dl(_terms(rest.splitlines()), col_max=34)
            else:
                self._write_wrapped(" ".join(paragraph.split()), self.current_indent)

    def write_dl(self, rows: Iterable[tuple[str, str]], col_max: int = 30, col_spacing: int = 2) -> None:
        """Terms and what they mean, side by side where both have room, else one below the other."""
        rows = list(rows)
        column = self.current_indent + col_spacing + min(max(len(term) for term, _ in rows), col_max)
        stacked = self.width - column < LEAST_COLUMN
        if stacked:
            column = self.current_indent + 4
        for term, meaning in rows:
            if stacked or self.current_indent + len(term) + col_spacing > column or not meaning:
                self._write_wrapped(term, self.current_indent, further=2)
                self._write_wrapped(meaning, column)
            else:
                start = (" " * self.current_indent + term).ljust(column)
                self._write_wrapped(meaning, column, start)

    def write_command(self, line: str) -> None:
        """A line to paste; one that is too long goes on below, as a shell reads it; options keep their values."""
        indent = " " * self.current_indent
        bound = re.sub(r"( -[-\w]+) (?=[^-\s])", rf"\1{BOUND}", line)
        parts = _wrapped(bound, self.width - 2, indent, indent + "  ")
        self.write(" \\\n".join(parts) + "\n")

    def write_usage(self, prog: str, args: str = "", prefix: str | None = None) -> None:
        """The line that says what is typed."""
        self._write_wrapped(f"{prefix or 'Usage: '}{prog} {args}", 0, further=4)

    def write_heading(self, heading: str) -> None:
        """What stands above a group."""
        self._write_wrapped(f"{heading}:", self.current_indent)

    def _write_wrapped(self, text: str, indent: int, start: str | None = None, further: int = 0) -> None:
        first = " " * indent if start is None else start
        for line in _wrapped(text, self.width, first, " " * (indent + further)):
            self.write(line + "\n")


class Context(click.Context):
    """A context whose help is as wide as the terminal."""

    formatter_class = Formatter


class Command(click.Command):
    """A command with its options in groups and with examples.

    Args:
        groups: headings, each with the names of the options below it; every option stands in one.
        examples: lines to paste.
    """

    context_class = Context

    def __init__(self, *args: Any, groups: Groups, examples: Sequence[str], **how: Any) -> None:
        super().__init__(*args, **how)
        self.groups, self.examples = groups, tuple(examples)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """A section a group; what is in none, such as --help, at the end."""
        options = [one for one in self.get_params(ctx) if isinstance(one, click.Option)]
        rows = {one.name: row for one in options if (row := one.get_help_record(ctx))}
        for title, names in self.groups.items():
            with formatter.section(title):
                formatter.write_dl([rows.pop(name) for name in names])
        with formatter.section(OTHERS):
            formatter.write_dl(list(rows.values()))

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The examples."""
        with formatter.section("Examples"):
            for line in self.examples:
                formatter.write_command(line)  # type: ignore[attr-defined]  # the context's own formatter


class Commands(click.Group):
    """A group that says how its words are completed, too."""

    context_class = Context

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """A line for each shell."""
        with formatter.section("Completion by the tab key, of bash, zsh and fish"):
            for line in COMPLETION:
                formatter.write_command(line)  # type: ignore[attr-defined]  # as above


def command(
    short_help: str, *, groups: Groups, examples: Sequence[str]
) -> Callable[[Callable[..., Any]], Command]:
    """A function as a command. As `click.command`, with what `Command` takes."""
    return click.command(cls=Command, short_help=short_help, groups=groups, examples=examples)


def _terms(lines: Iterable[str]) -> list[tuple[str, str]]:
    """Terms and meanings; a line that is set in goes on with the meaning before it."""
    found: list[tuple[str, str]] = []
    for line in inspect.cleandoc("\n".join(lines)).splitlines():
        if line.startswith(" "):
            term, meaning = found.pop()
            found.append((term, f"{meaning} {line.strip()}"))
        else:
            term, _, meaning = re.sub(r"\s{2,}", "\0", line, count=1).partition("\0")
            found.append((term, meaning))
    return found


def _wrapped(text: str, width: int, first: str, further: str) -> list[str]:
    wrapper = textwrap.TextWrapper(
        width,
        initial_indent=first,
        subsequent_indent=further,
        break_long_words=False,
        break_on_hyphens=False,
    )
    bound = text.replace("[default: ", f"[default:{BOUND}")
    return [line.replace(BOUND, " ") for line in wrapper.wrap(bound)]
