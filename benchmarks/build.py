"""Processor time of a build from nothing: this tree against another revision, in one run.

    python -m benchmarks.build --against v0.1.0 [--repeats 3]

Configuring and every compiler count, a compiler cache does not. Trees are built in turn; the least of each
tree's times is what the ratio is of.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
SLOWEST = 8


def check_out(revision: str, folder: Path) -> None:
    """The files of a revision, without touching the repository."""
    folder.mkdir()
    with subprocess.Popen(["git", "-C", ROOT, "archive", revision], stdout=subprocess.PIPE) as archive:
        subprocess.run(["tar", "-x", "-C", folder], stdin=archive.stdout, check=True)
    if archive.returncode:
        raise SystemExit(f"git archive {revision} failed: give a revision of this repository")


def tool(name: str) -> str:
    """A build tool, this interpreter's own where it has one."""
    own = Path(sys.executable).parent / name
    found = str(own) if own.exists() else shutil.which(name)
    if found is None:
        raise SystemExit(f"{name} is not installed: pip install {name}")
    return found


def build(source: Path, folder: Path, jobs: int) -> float:
    """Processor seconds of configuring and building into an empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    environment = {**os.environ, "CCACHE_DISABLE": "1"}
    environment.pop("CMAKE_CXX_COMPILER_LAUNCHER", None)
    configure = [
        *(tool("cmake"), "-S", source, "-B", folder, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release"),
        *("-DSKBUILD_PROJECT_VERSION=0.1.0", f"-DPython_EXECUTABLE={sys.executable}"),
        f"-DCMAKE_MAKE_PROGRAM={tool('ninja')}",
    ]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    for command in (configure, [tool("ninja"), f"-j{jobs}", "-C", folder]):
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def slowest_steps(folder: Path) -> list[tuple[float, str]]:
    """Steps of the last build that took longest, s of wall-clock, from Ninja's log."""
    steps = []
    for line in (folder / ".ninja_log").read_text(encoding="utf-8").splitlines()[1:]:
        begin, end, _, name, _ = line.split("\t")
        steps.append(((int(end) - int(begin)) / 1000, name.split(".dir/")[-1]))
    return sorted(steps, reverse=True)[:SLOWEST]


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", required=True, metavar="REVISION")
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="one: times of steps mean something")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        check_out(given.against, folder / "source")
        trees = {given.against: folder / "source", "this tree": ROOT}
        least = dict.fromkeys(trees, float("inf"))
        for _ in range(given.repeats):
            for label, source in trees.items():
                least[label] = min(least[label], build(source, folder / label.replace("/", "-"), given.jobs))
        for label, seconds in least.items():
            print(f"{label}: {seconds:.1f} s of processor time")
            for wall, step in slowest_steps(folder / label.replace("/", "-")):
                print(f"  {wall:5.1f} s  {step}")
    print(f"ratio {least['this tree'] / least[given.against]:.3f}")


if __name__ == "__main__":
    main(sys.argv[1:])
