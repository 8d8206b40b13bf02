"""One wheel run by one CPython: installed with what it needs, its demo, its numbers, the tests of a room."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from compare import ANSWERS, Numbers
from interpreters import Interpreter
from tools import ROOT, WORK, WheelError, run, tools

__all__ = ["Trial"]

TESTED = ("tests/registration", "tests/core")


class Trial:
    """A wheel installed in a folder of its own."""

    def __init__(self, wheel: Path, python: Interpreter) -> None:
        self.python = python
        self.folder = WORK / "run" / f"{python.target}-{python.version[1]}"
        shutil.rmtree(self.folder, ignore_errors=True)
        # Hypothesis reads the source of all modules that lie in folders of another name.
        self.site = self.folder / "site-packages"
        _install(wheel, python, self.site)

    def run(self, *arguments: str, cwd: Path | None = None) -> str:
        """What the interpreter prints; the folder it runs in knows nothing of the source."""
        environment = {
            "PYTHONPATH": str(self.site),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }
        return run([*self.python.command, *arguments], environment, cwd or self.folder)

    def demo(self) -> None:
        """The first command of the README."""
        self.run("-m", "sonocal", "demo", "-o", "demo", "--no-report")
        if not (self.folder / "demo" / "calibration.json").is_file():
            raise WheelError("sonocal demo wrote no calibration")

    def answers(self) -> tuple[str, Numbers]:
        """The chosen kernel, and what the build finds."""
        said = json.loads(self.run(str(ANSWERS)))
        return said["about"]["kernel"], said["numbers"]

    def tests(self) -> str:
        """The closing line of the tests of what is compiled."""
        copy = self.folder / "tree"
        for room in ("tests", "benchmarks"):
            shutil.copytree(ROOT / room, copy / room, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", copy)
        said = self.run("-m", "pytest", "-p", "no:cacheprovider", *TESTED, cwd=copy)
        return next((line for line in reversed(said.splitlines()) if "passed" in line), "tests passed")


def _install(wheel: Path, python: Interpreter, site: Path) -> None:
    """The wheel with what it needs, as pip chooses it for that CPython and machine."""
    major, minor = python.version
    abis = [f"cp{major}{minor}", "abi3", "none"]
    options: list[str | Path] = [
        *("--target", site, "--only-binary", ":all:", "--implementation", "cp"),
        *("--python-version", f"{major}.{minor}"),
        *(part for abi in abis for part in ("--abi", abi)),
        *(part for platform in python.platforms for part in ("--platform", platform)),
    ]
    pip: list[str | Path] = [tools(), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    run([*pip, *options, wheel, "pytest", "hypothesis"])
