"""What a device's name says of whose pose it sends, in words that a recording can hold."""

from __future__ import annotations

import re

__all__ = ["TRACKER", "frames_of"]

TRACKER = "Tracker"
MOST_LETTERS = 60
TRANSFORM = re.compile(r"(.+?)To([A-Z0-9_].*)")


def frames_of(device: str) -> tuple[str, str]:
    """What is tracked and in whose frame: ``("Probe", "Tracker")`` of "ProbeToTracker", as of "Probe" alone."""
    word = re.sub(r"\W", "_", device, flags=re.ASCII)[:MOST_LETTERS] or "Tool"
    match = TRANSFORM.fullmatch(word.removesuffix("Transform"))
    return (match[1], match[2]) if match else (word, TRACKER)
