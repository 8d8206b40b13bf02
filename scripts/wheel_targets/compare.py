"""Compares the numbers of two builds.

    python compare.py PYTHON OTHER_PYTHON

Exit status 1 where they are apart.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

__all__ = ["ANSWERS", "MOST_APART", "Numbers", "apart"]

Numbers = Mapping[str, list[float]]
ANSWERS = Path(__file__).with_name("answers.py")
MOST_APART = 1e-6
"""How far a number may be from another build's, of 1 + its size."""


def apart(found: Numbers, expected: Numbers) -> float:
    """How far two builds' numbers are apart at most, of 1 + their size; infinite where there are more of one."""
    if {kind: len(row) for kind, row in found.items()} != {kind: len(row) for kind, row in expected.items()}:
        return float("inf")
    distances = [
        abs(a - b) / (1 + abs(b))
        for kind, row in found.items()
        for a, b in zip(row, expected[kind], strict=True)
    ]
    # Not max(), which would pass over what is not a number.
    return max(distances) if distances and all(one >= 0 for one in distances) else float("inf")


def main(pythons: list[str]) -> int:
    """Print what each is and how far they are apart."""
    said = [
        json.loads(subprocess.run([python, ANSWERS], capture_output=True, text=True, check=True).stdout)
        for python in pythons
    ]
    distance = apart(*(one["numbers"] for one in said))
    print(f"numbers of the two builds are {distance:.1e} apart; kernel {said[0]['about']['kernel']}")
    return int(not distance <= MOST_APART)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:3]))
