"""Which room of the C++ core may include which, as data, and the check of it."""

from __future__ import annotations

import re
import sys
from pathlib import Path

CPP = Path(__file__).parent.parent / "cpp"

# A room is a folder of cpp/sonocal; rows stand below the rooms that they may include.
ALLOWED: dict[str, set[str]] = {
    "interrupt": set(),
    "linalg": set(),
    "robust": {"interrupt"},
    "solvers/lanes": set(),
    "detection": {"interrupt", "linalg"},
    "igtl": set(),
    "reconstruction": {"interrupt"},
    "solvers": {"interrupt", "linalg", "solvers/lanes"},
    "correspondences": {"interrupt", "linalg", "robust", "solvers", "solvers/lanes"},
    "estimate": {"interrupt", "linalg", "robust", "solvers", "correspondences"},
    "places": {"interrupt", "linalg", "robust", "correspondences", "estimate"},
    "study": {"linalg", "robust", "solvers", "estimate"},
}
INCLUDE = re.compile(r'^#include "sonocal/(?P<room>[\w/]+)/\w+\.hpp"', re.MULTILINE)


def upward_rows() -> list[str]:
    """Rows that name a room at or below their own place: without any, there is no circle."""
    rooms = list(ALLOWED)
    return [
        f"{Path(__file__).name}: {room} includes {other}, which stands no higher in the table"
        for place, room in enumerate(rooms)
        for other in sorted(ALLOWED[room])
        if other not in rooms[:place]
    ]


def problems(path: Path) -> list[str]:
    """What one file of the core includes and may not."""
    room = path.parent.relative_to(CPP / "sonocal").as_posix()
    if room not in ALLOWED:
        return [f"{path}: the room {room!r} has no row in the table of {Path(__file__).name}"]
    others = {match["room"] for match in INCLUDE.finditer(path.read_text(encoding="utf-8"))}
    return [f"{path}: {room} must not include {other}" for other in sorted(others - ALLOWED[room] - {room})]


def main() -> int:
    """Print what breaks the table; 1 if anything does."""
    files = [path for path in sorted((CPP / "sonocal").rglob("*")) if path.suffix in {".cpp", ".hpp"}]
    found = upward_rows() + [problem for path in files for problem in problems(path)]
    print("\n".join(found) if found else "includes follow the table")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
