"""``python -m sonocal`` is ``sonocal``."""

import sys


def main() -> None:
    """Runs the command line; ctrl-C ends it in a word from the first moment on, while its modules load, too."""
    try:
        from sonocal.cli import main as command
    except KeyboardInterrupt:
        sys.exit("\nAborted!")
    command(prog_name="sonocal")


if __name__ == "__main__":
    main()
