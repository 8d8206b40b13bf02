"""Call the core, the package's face, its readers or its codec with what is hostile: they answer, or refuse in words.

    scripts/sanitize                                             a build with sanitizers, and some calls of it
    python scripts/fuzz_calls.py --calls 100000 --module build/sanitize/_core.*.so
    python scripts/fuzz_calls.py --of python --calls 1000000     functions, files and commands
    python scripts/fuzz_calls.py --of files --each --calls 1000000 --counts DIR    so many damaged files of each reader
    python scripts/fuzz_calls.py --of igtl --calls 1000000       messages of OpenIGTLink
    python scripts/fuzz_calls.py --only 4711                     that call alone

Lengths that differ, codes below 0 or huge, NaN, infinities, 1e300, no rows, strides, other types, extreme options,
degenerate geometry; what happens to files is in tests/builders/damage.py. Each call has a generator of its own from
the seed and its number, so that any of them can be repeated alone. They run in another process, which is started anew
behind a call that ended it. A call that takes a minute of processor time, ten by the clock, or a GiB more than the
process began with, is a fault, too. Counts that are kept in a folder are gone on with when they are asked for again.
"""

from __future__ import annotations

import argparse
import faulthandler
import importlib
import importlib.util
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

SEED = 20160908
# A process that others starve is slow by the clock; one that waits for ever takes no processor time.
LONGEST_S = {signal.ITIMER_PROF: 60, signal.ITIMER_REAL: 600}
MOST_BYTES = 1 << 30
# Behind so many, one fault hides the others.
MOST_FAULTS = 30
# Memory where there is some, since calls write files.
SCRATCH = Path("/dev/shm") if Path("/dev/shm").is_dir() else None

# One is imported, not several: the package brings its own core, beside which another one cannot be loaded.
KINDS = {
    "core": "tests.builders.core_calls",
    "python": "tests.builders.python_calls",
    "files": "tests.builders.file_calls",
    "igtl": "tests.builders.igtl_calls",
}


class Count(NamedTuple):
    """How far calls are: the number of the next, how many were answered, how many were faults, and the slowest."""

    next: int = 0
    answered: int = 0
    faults: int = 0
    slowest_ms: int = 0
    slowest: int = 0

    @classmethod
    def kept(cls, log: Path) -> Count:
        """The count in a file; of nothing where there is none."""
        return cls(*map(int, log.read_text().split())) if log.exists() else cls()

    def keep(self, log: Path) -> None:
        """Write it to a file."""
        log.write_text(f"{' '.join(map(str, self))}\n")

    def said(self) -> str:
        refused = self.next - self.answered - self.faults
        slowest = f"the slowest took {self.slowest_ms} ms (--only {self.slowest})"
        return (
            f"{self.next} calls: {self.answered} answered, {refused} refused, {self.faults} faults; {slowest}"
        )


def run(call: Callable[[int], bool], end: int, log: Path) -> None:
    """Make calls one after the other; the log holds how far they are, whatever one of them does to the process."""
    _, answered, faults, slowest, which = Count.kept(log)
    for ending in (signal.SIGPROF, signal.SIGALRM):
        faulthandler.register(ending, chain=True)
    with log.open("r+") as file:
        for number in range(Count.kept(log).next, end):
            file.seek(0)
            file.write(f"{number} {answered} {faults} {slowest} {which}\n")
            file.flush()
            for timer, longest_s in LONGEST_S.items():
                signal.setitimer(timer, longest_s)
            begin = time.perf_counter()
            answered += call(number)
            took = int(1000 * (time.perf_counter() - begin))
            if took > slowest:
                slowest, which = took, number
    Count(end, answered, faults, slowest, which).keep(log)


def limit_memory() -> None:
    """Let this process have so much more than it has."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MOST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


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


def survey(names: Sequence[str], calls: int, log: Path, scratch: Path) -> Count:
    """Make so many calls in other processes, with this one's arguments, and count those that ended one."""
    if not log.exists():
        Count().keep(log)
    command = [sys.executable, *sys.argv, "--part", str(log), "--among", *names]
    environment = {**os.environ, "TMPDIR": str(scratch)}
    while (count := Count.kept(log)).next < calls and count.faults < MOST_FAULTS:
        if subprocess.run(command, env=environment, check=False).returncode != 0:
            at = Count.kept(log)
            among = f"--among {' '.join(names)} " if len(names) == 1 else ""
            print(
                f"call {at.next} of {names[at.next % len(names)]} ended the process; {among}--only {at.next}"
            )
            at._replace(next=at.next + 1, faults=at.faults + 1).keep(log)
    return count


def asked() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--of", choices=list(KINDS), default="core", help="what is called")
    parser.add_argument("--calls", type=int, default=2000)
    parser.add_argument("--each", action="store_true", help="so many of each name, one after the other")
    parser.add_argument("--among", nargs="+", metavar="NAME", help="of these alone")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--module", type=Path, help="a compiled core; default: the installed package's")
    parser.add_argument("--only", type=int, metavar="NUMBER", help="this call alone, in this process")
    parser.add_argument("--counts", type=Path, help="the folder that keeps how far each is")
    parser.add_argument("--part", type=Path, metavar="LOG", help=argparse.SUPPRESS)
    return parser.parse_args()


def surveys(arguments: argparse.Namespace, names: Sequence[str]) -> int:
    """Make the calls that are asked for; how many were faults."""
    scratch = Path(tempfile.mkdtemp(prefix="fuzz-calls-", dir=SCRATCH))
    counts = arguments.counts or scratch
    counts.mkdir(parents=True, exist_ok=True)
    faults = 0
    try:
        for some in [[name] for name in names] if arguments.each else [names]:
            what = f"{arguments.of}-{'-'.join(some) if arguments.among or arguments.each else 'all'}"
            count = survey(some, arguments.calls, counts / f"{what}-{arguments.seed}.txt", scratch)
            print(f"{what}: {count.said()}", flush=True)
            faults += count.faults
    finally:
        shutil.rmtree(scratch)
    return faults


def main() -> int:
    """Call what is asked for; 1 if a call ended a process or there is none for a function."""
    arguments = asked()
    calls = importlib.import_module(KINDS[arguments.of])
    core = load(arguments.module) if arguments.of == "core" else None
    names = arguments.among or list(calls.CALLS)

    def call(number: int) -> bool:
        return bool(calls.call(core, arguments.seed, number, names[number % len(names)]))

    if arguments.part:
        if core is None:  # what runs with a sanitizer reserves terabytes
            limit_memory()
        run(call, arguments.calls, arguments.part)
    elif arguments.only is not None:
        print("answered" if call(arguments.only) else "refused")
    elif unreached := calls.missing(core):
        print(f"no call reaches {', '.join(sorted(unreached))}; add one to CALLS")
        return 1
    else:
        return int(surveys(arguments, names) > 0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
