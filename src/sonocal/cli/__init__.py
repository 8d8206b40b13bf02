"""The command line. Thin: parse, call, print; heavy imports inside the commands."""

from sonocal.cli.main import main

__all__ = ["main"]
