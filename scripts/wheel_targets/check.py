"""Checks wheels: looks into all, and runs those that a CPython can be had for.

The numbers of each are compared with those of the build from source in .venv.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from compare import ANSWERS, MOST_APART, Numbers, apart
from interpreters import VERSIONS, Interpreter, interpreters
from targets import FLOOR, STABLE, TARGETS
from tools import ROOT, WheelError, host, run, tools
from trial import Trial


def looked_into(wheels: list[Path]) -> None:
    """Size, tag, symbols and oldest system of each.

    Raises:
        WheelError: one is not as it must be.
    """
    code = (
        "import sys, sysconfig, pathlib as p; v = sysconfig.get_config_var; "
        "print(p.Path(v('LIBDIR'), v('INSTSONAME')) if v('Py_ENABLE_SHARED') else sys.executable)"
    )
    program = run([host(FLOOR), "-c", code]).strip()
    print(run([tools(), Path(__file__).with_name("look.py"), program, *wheels]), end="")
    for wheel in wheels:
        if "manylinux" in wheel.name:
            said = " ".join(run([tools(), "-m", "auditwheel", "show", wheel]).split())
            if "manylinux_2_17" not in said:
                raise WheelError(f"{wheel.name}: auditwheel says {said}")


def wheel_for(python: Interpreter, wheels: list[Path]) -> Path | None:
    """The wheel that a CPython takes."""
    tag = TARGETS[python.target].tag(FLOOR if python.version < STABLE else STABLE)
    return next((wheel for wheel in wheels if wheel.stem.endswith(tag)), None)


def tried(wheel: Path, python: Interpreter, expected: Numbers, *, tests: bool) -> str:
    """A sentence on a wheel that was run.

    Raises:
        WheelError: it does not do what the build from source does.
    """
    trial = Trial(wheel, python)
    trial.demo()
    kernel, numbers = trial.answers()
    distance = apart(numbers, expected)
    if not distance <= MOST_APART:
        raise WheelError(f"{wheel.name} on {python.target}: its numbers are {distance:.1e} from the source's")
    said = f"demo done, numbers {distance:.1e} from the source's, kernel {kernel}"
    return f"{said}, {trial.tests()}" if tests else said


def of_the_source(python: Path) -> Numbers:
    """The numbers of the build from source.

    Raises:
        WheelError: there is none.
    """
    if not python.exists():
        raise WheelError(
            f"{python}: is not there; scripts/demo builds from source, or --source names another CPython that has it"
        )
    numbers: Numbers = json.loads(run([python, ANSWERS]))["numbers"]
    return numbers


def reports(
    wheels: list[Path], targets: list[str], versions: Sequence[str], expected: Numbers, *, tests: bool
) -> Iterator[str]:
    """A line for each CPython, run or not."""
    for python in interpreters(targets, versions):
        if isinstance(python, str):
            yield python
        elif wheel := wheel_for(python, wheels):
            version = ".".join(map(str, python.version))
            said = tried(wheel, python, expected, tests=tests and python.tests_are_worth_it)
            yield f"{python.target}, CPython {version} ({python.origin}): {said}"


def main() -> None:
    """Check the wheels of a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)}; all of them")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="the folder with the wheels; dist")
    parser.add_argument(
        "--python",
        action="append",
        choices=VERSIONS,
        help="a CPython to run, may be given again; all of them",
    )
    parser.add_argument("--no-tests", action="store_true", help="only the demo and the numbers")
    parser.add_argument("--look", action="store_true", help="run none")
    parser.add_argument(
        "--source", type=Path, default=ROOT / ".venv/bin/python", help="CPython with the build from source"
    )
    asked = parser.parse_args()
    targets = asked.targets or list(TARGETS)
    tags = [TARGETS[name].tag(version) for name in targets for version in (FLOOR, STABLE)]
    wheels = sorted(
        wheel for wheel in asked.out.glob("*.whl") if any(wheel.stem.endswith(tag) for tag in tags)
    )
    if not wheels:
        raise WheelError(f"{asked.out}: holds no wheels of {', '.join(targets)}; scripts/wheels makes them")
    looked_into(wheels)
    if not asked.look:
        expected = of_the_source(asked.source)
        for line in reports(wheels, targets, asked.python or VERSIONS, expected, tests=not asked.no_tests):
            print(line, flush=True)


if __name__ == "__main__":
    try:
        main()
    except WheelError as error:
        sys.exit(str(error))
