"""Which room may import which, as data, and the check of it."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

PACKAGE = Path(__file__).parent.parent / "src" / "sonocal"

# Every room may import `errors`, `files`, `findings`, `geometry`, `tables` and NumPy, except where its row says less.
# A room is a module or a folder beside __init__.py; the calibration room has several modules.
EVERYONE = {"errors", "files", "findings", "geometry", "tables"}
CALIBRATION = {"calibration", "calibration_file", "diagnostics"}
ALLOWED: dict[str, set[str]] = {
    "errors": set(),
    "files": {"errors"},
    "findings": set(),
    "geometry": {"errors"},
    "tables": {"errors"},
    "contents": EVERYONE,
    "observations": EVERYONE,
    "registration": EVERYONE | {"_core"},
    "recording": EVERYONE,
    "detection": EVERYONE | {"recording", "_core"},
    "tool_calibration": EVERYONE | {"recording"},
    "sightings": EVERYONE | {"observations", "recording"},
    "candidates": EVERYONE | CALIBRATION | {"observations", "registration"},
    "needle_sweep": EVERYONE
    | CALIBRATION
    | {"candidates", "detection", "observations", "recording", "second_look", "sightings"},
    "second_look": EVERYONE | {"candidates", "detection", "observations", "recording"},
    "contact_sheet": EVERYONE | {"detection", "recording"},
    "diagnostics": EVERYONE | {"registration"},
    # `report` only inside Calibration.plot_..., when one is called.
    "calibration": EVERYONE
    | CALIBRATION
    | {"observations", "registration", "recording", "detection", "report"},
    "calibration_file": EVERYONE | CALIBRATION | {"registration"},
    "export": EVERYONE | CALIBRATION,
    "validation": EVERYONE | CALIBRATION | {"observations", "registration"},
    "setup_checks": EVERYONE | CALIBRATION | {"observations", "registration"},
    "report": EVERYONE | CALIBRATION | {"observations", "registration", "validation"},
    "terminal_validation": EVERYONE | CALIBRATION | {"report", "terminal_parts", "validation"},
    "simulation": EVERYONE | {"recording", "observations"},
    "studies": EVERYONE
    | CALIBRATION
    | {"_core", "observations", "registration", "report", "simulation", "validation"},
    "terminal_parts": EVERYONE,
    "terminal_study": EVERYONE | {"studies"},
    "terminal": EVERYONE | CALIBRATION | {"observations", "registration", "simulation", "terminal_parts"},
    "terminal_recording": EVERYONE | {"recording", "sightings", "terminal_parts", "tool_calibration"},
}
# These see everything: the public face and the command line.
UNRESTRICTED = {"__init__", "__main__"} | {path.stem for path in PACKAGE.glob("cli*.py")}
# Third parties that a room's own import must not drag in: `import sonocal` stays fast.
LAZY = {
    "scipy",
    "click",
    "rich",
    "matplotlib",
    "jinja2",
    "h5py",
    "nrrd",
    "pydicom",
    "av",
    "PIL",
    "dask",
    "distributed",
}
LAZY_EXEMPT = {path.stem: {"click"} for path in PACKAGE.glob("cli*.py")}
LAZY_EXEMPT |= {path.stem: {"rich"} for path in PACKAGE.glob("terminal*.py")}


def imported(tree: ast.AST, *, module_level: bool) -> set[str]:
    """Dotted names that a module imports, anywhere or only where it is itself imported."""
    names: set[str] = set()
    nodes = tree.body if module_level and isinstance(tree, ast.Module) else ast.walk(tree)
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= (
                {f"{node.module}.{alias.name}" for alias in node.names}
                if node.module == "sonocal"
                else {node.module}
            )
    return names


def problems(path: Path) -> list[str]:
    """What one module imports and may not."""
    room = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    if room in UNRESTRICTED and not room.startswith("cli"):
        return []
    if room not in ALLOWED and room not in UNRESTRICTED:
        return [f"{path}: the room {room!r} has no row in the import table of {Path(__file__).name}"]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = []
    if room not in UNRESTRICTED:
        for name in sorted(imported(tree, module_level=False)):
            parts = name.split(".")
            if parts[0] == "sonocal" and len(parts) > 1 and parts[1] not in ALLOWED[room] | {room}:
                found.append(f"{path}: {room} must not import {name}")
    for name in sorted(imported(tree, module_level=True)):
        if name.split(".")[0] in LAZY - LAZY_EXEMPT.get(room, set()):
            found.append(f"{path}: import {name} inside the function that needs it")
    return found


def main() -> int:
    """Print what breaks the table; 1 if anything does."""
    found = [problem for path in sorted(PACKAGE.rglob("*.py")) for problem in problems(path)]
    print("\n".join(found) if found else "imports follow the table")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
