"""Text for a terminal: whatever names and remarks files hold, no control character of theirs reaches it."""

from __future__ import annotations

import re

__all__ = ["harmless", "say", "say_json"]

# What moves the cursor, rings, recolours or turns the direction of text; tabs and line ends stay.
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def harmless(text: str) -> str:
    """A text with every control character replaced by the sign for what cannot be shown."""
    return CONTROL.sub("\N{REPLACEMENT CHARACTER}", text)


def say(text: str, *, err: bool = False) -> None:
    """Print a line as it is, but for control characters."""
    import click

    click.echo(harmless(text), err=err)


def say_json(record: object) -> None:
    """Print a result for programs: JSON, with the control characters escaped that JSON itself leaves alone.

    Args:
        record: of plain values, arrays and msgspec's or data classes; or JSON that was encoded already.
    """
    import click
    import msgspec

    encoded = record
    if not isinstance(encoded, bytes):
        encoded = msgspec.json.format(
            msgspec.json.encode(record, enc_hook=lambda array: array.tolist()), indent=1
        )
    text = encoded.decode().rstrip("\n")
    click.echo(CONTROL.sub(lambda one: f"\\u{ord(one[0]):04x}", text))
