"""Call everything in the core with hostile arrays: whatever arrives, it may only be answered or refused in a sentence.

    scripts/sanitize                                             a build with sanitizers, and some calls of it
    python scripts/fuzz_core.py --calls 100000 --module build/sanitize/_core.*.so
    python scripts/fuzz_core.py --only 4711                      that call alone

Lengths that differ, codes below 0 or huge, NaN, infinities, 1e300, no rows, strides, other types, extreme options,
degenerate geometry. Each call has a generator of its own from the seed and its number, so that any of them can be
repeated alone. They run in another process, which is started anew behind a call that ended it. A call that takes longer
than a minute is a fault, too.
"""

from __future__ import annotations

import argparse
import faulthandler
import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))
from tests.builders.hostile import CALLS, call, missing  # noqa: E402

SEED = 20160908
LONGEST_S = 60


def run(core: ModuleType, seed: int, begin: int, end: int, log: Path) -> None:
    """Make calls one after the other; the log holds the number of the last and how many were answered."""
    answered = 0
    with log.open("w") as file:
        for number in range(begin, end):
            file.seek(0)
            file.write(f"{number} {answered}\n")
            file.flush()
            faulthandler.dump_traceback_later(LONGEST_S, exit=True)
            answered += call(core, seed, number)
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


def main() -> int:
    """Make the calls in other processes; the number of those that ended one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument(
        "--module", type=Path, help="the compiled core; default: that of the installed package"
    )
    parser.add_argument("--only", type=int, metavar="NUMBER", help="this call alone, in this process")
    parser.add_argument("--part", type=int, nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--log", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.part:
        run(load(arguments.module), arguments.seed, *arguments.part, arguments.log)
        return 0
    if arguments.only is not None:
        print("answered" if call(load(arguments.module), arguments.seed, arguments.only) else "refused")
        return 0
    if unreached := missing(load(arguments.module)):
        print(f"no call reaches {', '.join(sorted(unreached))}; add one to CALLS")
        return 1
    log = Path(tempfile.mkdtemp(prefix="fuzz-core-")) / "log"
    begin = answered = faults = 0
    while begin < arguments.calls:
        part = ["--part", str(begin), str(arguments.calls), "--log", str(log)]
        done = subprocess.run([sys.executable, *sys.argv, *part], check=False, env=os.environ)
        begin, now = map(int, log.read_text().split())
        answered += now
        if done.returncode != 0:
            faults += 1
            print(
                f"call {begin} of {list(CALLS)[begin % len(CALLS)]} ended the process; --only {begin}",
                flush=True,
            )
            begin += 1
    refused = arguments.calls - answered - faults
    print(f"{arguments.calls} calls: {answered} answered, {refused} refused, {faults} faults")
    return min(faults, 100)


if __name__ == "__main__":
    sys.exit(main())
