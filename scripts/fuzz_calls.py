"""Call the core, or the package's face, with hostile arguments: each may only be answered or refused in a sentence.

    scripts/sanitize                                             a build with sanitizers, and some calls of it
    python scripts/fuzz_calls.py --calls 100000 --module build/sanitize/_core.*.so
    python scripts/fuzz_calls.py --of python --calls 1000000     functions, files and commands
    python scripts/fuzz_calls.py --only 4711                     that call alone

Lengths that differ, codes below 0 or huge, NaN, infinities, 1e300, no rows, strides, other types, extreme options,
degenerate geometry. Each call has a generator of its own from the seed and its number, so that any of them can be
repeated alone. They run in another process, which is started anew behind a call that ended it. A call that takes longer
than a minute is a fault, too.
"""

from __future__ import annotations

import argparse
import faulthandler
import importlib
import importlib.util
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

SEED = 20160908
LONGEST_S = 60


# One is imported, not both: the package brings its own core, beside which another one cannot be loaded.
KINDS = {"core": "tests.builders.core_calls", "python": "tests.builders.python_calls"}


def run(calls: ModuleType, core: ModuleType | None, part: tuple[int, int, int], log: Path) -> None:
    """Make calls one after the other; the log holds the number of the last and how many were answered."""
    answered = 0
    seed, begin, end = part
    with log.open("w") as file:
        for number in range(begin, end):
            file.seek(0)
            file.write(f"{number} {answered}\n")
            file.flush()
            faulthandler.dump_traceback_later(LONGEST_S, exit=True)
            answered += calls.call(core, seed, number)
        file.seek(0)
        file.write(f"{end} {answered}\n")


def load(path: Path | None) -> ModuleType:
    """The core of the installed package, or the one in a file."""
    if path is None:
        from sonocal import _core

        return _core
    spec = importlib.util.spec_from_file_location("_core", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def survey(made: ModuleType, calls: int) -> int:
    """Make so many calls in other processes, with this one's arguments; the number of those that ended one."""
    log = Path(tempfile.mkdtemp(prefix="fuzz-core-")) / "log"
    begin = answered = faults = 0
    while begin < calls:
        part = ["--part", str(begin), str(calls), "--log", str(log)]
        done = subprocess.run([sys.executable, *sys.argv, *part], check=False)
        begin, now = map(int, log.read_text().split())
        answered += now
        if done.returncode != 0:
            name = list(made.CALLS)[begin % len(made.CALLS)]
            print(f"call {begin} of {name} ended the process; --only {begin}", flush=True)
            faults, begin = faults + 1, begin + 1
    print(f"{calls} calls: {answered} answered, {calls - answered - faults} refused, {faults} faults")
    return faults


def asked() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--of", choices=list(KINDS), default="core", help="what is called")
    parser.add_argument("--calls", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--module", type=Path, help="a compiled core; default: the installed package's")
    parser.add_argument("--only", type=int, metavar="NUMBER", help="this call alone, in this process")
    parser.add_argument("--part", type=int, nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--log", type=Path, help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> int:
    """Call the core; 1 if a call ended a process or there is none for a function."""
    arguments = asked()
    calls = importlib.import_module(KINDS[arguments.of])
    core = load(arguments.module) if arguments.of == "core" else None
    if arguments.part:
        run(calls, core, (arguments.seed, *arguments.part), arguments.log)
    elif arguments.only is not None:
        print("answered" if calls.call(core, arguments.seed, arguments.only) else "refused")
    elif unreached := calls.missing(core):
        print(f"no call reaches {', '.join(sorted(unreached))}; add one to CALLS")
        return 1
    else:
        return int(survey(calls, arguments.calls) > 0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
