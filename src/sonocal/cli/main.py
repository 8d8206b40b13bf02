"""The command line. Thin: parse, call, print; heavy imports inside the commands."""

from __future__ import annotations

import io
import re
import sys
from typing import Any

import click

from sonocal import __version__
from sonocal.cli.calibrate import calibrate
from sonocal.cli.convert import convert
from sonocal.cli.demo import demo
from sonocal.cli.detection import COMMANDS
from sonocal.cli.export import export
from sonocal.cli.help import Commands
from sonocal.cli.info import info
from sonocal.cli.live import live
from sonocal.cli.piped import without_spool
from sonocal.cli.reconstruct import reconstruct
from sonocal.cli.replay import replay
from sonocal.cli.sample import sample
from sonocal.cli.screen.plain import harmless
from sonocal.cli.studio import studio
from sonocal.cli.study import study
from sonocal.cli.tool import tool
from sonocal.cli.validate import validate
from sonocal.errors import SonocalError

__all__ = ["main"]


class _Commands(Commands):
    """A group whose foreseen failures are one sentence and exit status 1; a bug keeps its traceback."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except SonocalError as error:
            options = self.commands[ctx.invoked_subcommand].params if ctx.invoked_subcommand else []
            raise click.ClickException(
                harmless(without_spool(_in_options(str(error), options), ctx))
            ) from None


def _in_options(sentence: str, options: list[click.Parameter]) -> str:
    """A sentence on arguments of a Python function, with the options that they are on the command line."""
    for option in options:
        if option.name and "_" in option.name and option.opts[0].startswith("--"):
            sentence = re.sub(rf"\b{option.name}(?= (?:must|says|is|are|and)\b)", option.opts[0], sentence)
    return sentence


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="sonocal")
def main() -> None:
    """Calibrate a tracked ultrasound probe with a tracked needle.

    Start with "sonocal demo", then "sonocal calibrate observations.csv".

    Warnings and notes have a code: docs/findings.md has a section for each.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Into a file or a pipe, Windows writes a code page that lacks letters which names of files may have.
        sys.stdout.reconfigure(errors="backslashreplace")


for _command in (
    demo,
    sample,
    calibrate,
    *COMMANDS,
    tool,
    live,
    replay,
    studio,
    validate,
    study,
    export,
    reconstruct,
    convert,
    info,
):
    main.add_command(_command)
