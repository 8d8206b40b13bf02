"""Which room may import which, as data, and the check of it: no arrow upwards, no circle, nothing heavy at the door."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
SOURCE = ROOT / "src" / "sonocal"

# From the top of the house to its foundation: a room imports rooms below it that its row names, and what everyone may.
# A folder in a room that has a row of its own is a room.
EVERYONE = {"errors", "files", "findings", "geometry"}
ALL = {"*"}
ROOMS: dict[str, set[str]] = {
    "__main__": {"cli"},
    "cli": ALL,
    "cli.screen": ALL - {"cli"},
    "studio": {
        "live",
        "reconstruction",
        "tools",
        "sweep",
        "calibration",
        "validation",
        "detection",
        "recording",
        "observations",
        "registration",
        "targets",
    },
    "live": {"igtl", "sweep", "detection", "recording", "validation"},
    "devices": {"igtl"},
    "igtl": {"_core"},
    "studies": {
        "calibration",
        "observations",
        "registration",
        "report",
        "simulation",
        "validation",
        "_core",
    },
    "reconstruction": {
        "existing",
        "calibration",
        "detection",
        "recording",
        "recording.formats",
        "registration",
        "report",
        "targets",
        "_core",
    },
    "simulation": {"recording", "recording.formats", "observations", "targets"},
    "export": {"existing", "calibration", "validation", "targets"},
    "report": {"calibration", "validation", "observations", "registration", "tools"},
    "existing": {"validation", "calibration", "setup_checks", "registration", "observations", "targets"},
    "validation": {"calibration", "setup_checks", "observations", "registration"},
    "sweep": {
        "calibration",
        "setup_checks",
        "detection",
        "recording",
        "observations",
        "targets",
        "registration",
    },
    "calibration": {"setup_checks", "observations", "registration", "targets"},
    "setup_checks": {"observations", "registration"},
    "tools": {"recording", "registration", "targets"},
    "detection": {"recording", "recording.formats", "_core"},
    "registration": {"_core"},
    "recording.formats": {"recording"},
    "recording": {"targets"},
    "observations": {"targets"},
    "targets": set(),
    "geometry": {"errors", "findings"},
    "files": {"errors"},
    "errors": {"findings"},
    "findings": set(),
    "_core": set(),
}
# Modules that a room above is reached from by its name alone, when it is asked for: what a notebook shows of an object.
UPWARDS = {"calibration.in_session": {"report.session"}}
# The public face is lazy: it names rooms and imports none.
FACE = "__init__"
MOST_AT_THE_ROOT = 5

# Third parties that a room's own import must not drag in: `import sonocal` stays fast.
LAZY = {
    *("scipy", "click", "rich", "matplotlib", "jinja2", "h5py", "nrrd", "pydicom", "av", "PIL", "dask"),
    *("natnet", "ndicapy"),
    *("pandas", "distributed", "c3d", "starlette", "uvicorn", "websockets"),
}
LAZY_EXEMPT = {"cli": {"click"}, "cli.screen": {"click", "rich"}}

# What stands beside the package may import these, and nothing else of one another; benchmarks.house reads this table.
OUTSIDE = {
    "tests": {"tests", "scripts", "benchmarks", "docs"},
    "benchmarks": {"benchmarks", "scripts"},
    "scripts": {"tests", "benchmarks"},
    "docs": {"docs", "scripts"},
}
# Of the tests, this alone is imported: a test file is run, and nothing else.
BUILDERS = "tests.builders"


def main() -> int:
    """Print what breaks the table; 1 if anything does."""
    modules = {dotted(path): path for path in sorted(SOURCE.rglob("*.py"))}
    arrows = {name: imported(path, modules) for name, path in modules.items()}
    found = [
        *at_the_root(),
        *(problem for name in modules for problem in against_table(name, arrows[name])),
        *(problem for name, path in modules.items() for problem in heavy_imports(name, path)),
        *(problem for name, path in modules.items() for problem in by_name(name, path, modules)),
        *(f"a circle: {' -> '.join(circle)}" for circle in circles(arrows)),
        *outside(),
    ]
    print("\n".join(found) if found else "imports follow the table")
    return 1 if found else 0


def dotted(path: Path) -> str:
    """A module's name below the package; that of a folder for its face."""
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == FACE and len(parts) > 1 else parts)


def room_of(name: str) -> str:
    """The innermost room that a module stands in."""
    parts = name.split(".")
    rooms = (".".join(parts[:end]) for end in range(len(parts), 0, -1))
    return next((room for room in rooms if room in ROOMS), parts[0])


def imported(path: Path, modules: dict[str, Path]) -> set[str]:
    """The package's modules that one imports, anywhere in it."""
    found = set()
    for name in names_in(ast.walk(ast.parse(path.read_text(encoding="utf-8")))):
        if name.split(".")[0] == "sonocal":
            inside = name.removeprefix("sonocal").removeprefix(".")
            module = inside if inside in modules or inside == "_core" else inside.rpartition(".")[0]
            found |= {module or FACE}
    return found - {dotted(path)}


def names_in(nodes: Iterator[ast.AST]) -> Iterator[str]:
    """Dotted names that import statements bring in."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def against_table(name: str, arrows: set[str]) -> Iterator[str]:
    """Arrows of a module that its room's row does not allow, or that run upwards."""
    if name == FACE:
        return
    room, order = room_of(name), list(ROOMS)
    if room not in ROOMS:
        yield f"{name}: the room {room!r} has no row in the table of {Path(__file__).name}"
        return
    for other in sorted(arrows):
        to = room_of(other)
        if other == FACE and room != "cli":
            yield f"{name}: imports the public face; name the room that it wants"
        elif other != FACE and to != room and not allowed(room, to):
            yield f"{name}: {room} must not import {other}"
        elif to in ROOMS and order.index(to) < order.index(room):
            yield f"{name}: imports {other}, which stands above it"


def allowed(room: str, to: str) -> bool:
    """Whether a room's row, or what everyone may, names another room."""
    row = ROOMS[room]
    return to in row or "*" in row or (to in EVERYONE and room not in EVERYONE)


def heavy_imports(name: str, path: Path) -> Iterator[str]:
    """Third parties that are imported where the module is, and not where they are needed."""
    for third in sorted(set(names_in(iter(ast.parse(path.read_text(encoding="utf-8")).body)))):
        if third.split(".")[0] in LAZY - LAZY_EXEMPT.get(room_of(name), set()):
            yield f"{name}: import {third} inside the function that needs it"


def by_name(name: str, path: Path, modules: dict[str, Path]) -> Iterator[str]:
    """Modules above that one names in its text, as whoever imports by name does, and that `UPWARDS` does not allow."""
    order = list(ROOMS)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and node.value.startswith("sonocal.")
        ):
            other = node.value.removeprefix("sonocal.")
            if other in modules and name != FACE and other not in UPWARDS.get(name, ()):
                room, to = room_of(name), room_of(other)
                if room in ROOMS and order.index(to) < order.index(room):
                    yield f"{name}: names {other}, which stands above it"


def circles(arrows: dict[str, set[str]]) -> Iterator[list[str]]:
    """One circle for each module at which a walk along the arrows comes back to where it is."""
    done: set[str] = set()

    def walk(name: str, path: list[str]) -> Iterator[list[str]]:
        if name in path:
            yield [*path[path.index(name) :], name]
        elif name not in done:
            for other in sorted(arrows.get(name, ())):
                yield from walk(other, [*path, name])
            done.add(name)

    for name in arrows:
        yield from walk(name, [])


def at_the_root() -> Iterator[str]:
    """Modules that stand beside the rooms instead of in one."""
    standing = sorted(path.name for path in SOURCE.glob("*.py"))
    if len(standing) > MOST_AT_THE_ROOT:
        yield f"{len(standing)} modules at the package's root ({', '.join(standing)}); give them a room"


def outside() -> Iterator[str]:
    """Arrows between what stands beside the package, and imports inside it of what stands outside."""
    for folder, may in {**OUTSIDE, "src": set[str]()}.items():
        for path in sorted((ROOT / folder).rglob("*.py")):
            for name in names_in(ast.walk(ast.parse(path.read_text(encoding="utf-8")))):
                top = name.split(".")[0]
                if top in OUTSIDE and top not in may:
                    yield f"{path.relative_to(ROOT)}: {folder} must not import {name}"
                elif top == "tests" and not name.startswith(BUILDERS):
                    yield f"{path.relative_to(ROOT)}: import {name} from {BUILDERS}, where tests share what they need"


if __name__ == "__main__":
    sys.exit(main())
