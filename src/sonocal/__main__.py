"""``python -m sonocal`` is ``sonocal``."""

from sonocal.cli import main

main(prog_name="sonocal")
