"""``python -m sonocal`` is ``sonocal``."""

from sonocal.cli.main import main

main(prog_name="sonocal")
