"""Fuzz every reader with Atheris (libFuzzer): whatever is in a file, only a SonocalError may come out.

    pip install atheris
    python scripts/fuzz.py [READER ...] [--seconds 60]

Each reader runs in a process of its own, from the sound and the damaged files of the tests. A foreign exception, more
than a minute for one input or more than 1 GB of memory stops it; libFuzzer then names the file that holds the input.
The hypothesis tests (tests/recording/formats/test_fuzz.py) ask the same of fewer inputs, and run everywhere.
"""

from __future__ import annotations

import argparse
import gc
import importlib.util
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from types import FunctionType

ROOT = Path(__file__).parent.parent
LIMITS = [
    "-timeout=60",
    "-rss_limit_mb=1024",
    "-malloc_limit_mb=512",
    "-max_len=8192",
    "-print_final_stats=1",
]


def main() -> int:
    """Fuzz the readers asked for, one after the other; the number of those that failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("readers", nargs="*", help="default: all")
    parser.add_argument("--seconds", type=int, default=60, help="for each reader")
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        parser.error(
            "Atheris is not installed: pip install atheris (or run scripts/fuzz_calls.py, which needs nothing)"
        )
    sys.path.insert(0, str(ROOT))
    if arguments.folder:
        fuzz(arguments.readers[0], arguments.seconds, arguments.folder)
        return 0
    from tests.builders.readers import READERS

    failed = [name for name in arguments.readers or READERS if not passes(name, arguments.seconds)]
    print(f"failed: {', '.join(failed)}" if failed else "only sentences came out")
    return len(failed)


def passes(name: str, seconds: int) -> bool:
    """Whether a reader survives; what broke it stays in its folder."""
    folder = Path(tempfile.mkdtemp(prefix=f"fuzz-{name}-"))
    command = [sys.executable, __file__, name, "--seconds", str(seconds), "--folder", str(folder)]
    survived = subprocess.run(command, check=False).returncode == 0
    if survived:
        shutil.rmtree(folder)
    return survived


def fuzz(name: str, seconds: int, folder: Path) -> None:
    """Fuzz one reader; does not return."""
    import atheris
    from tests.builders.readers import (
        READERS,
        sound_files,
    )

    from sonocal import SonocalError

    # By function, since an editable installation has an importer of its own that Atheris cannot look into.
    for function in gc.get_objects():
        if isinstance(function, FunctionType) and str(function.__module__).startswith("sonocal."):
            atheris.instrument_func(function)
    seeds = folder / "seeds"
    seeds.mkdir()
    for i, content in enumerate(sound_files(name)):
        (seeds / str(i)).write_bytes(content)
    path = folder / f"input{READERS[name].suffix}"

    def target(content: bytes) -> None:
        path.write_bytes(content)
        try:
            READERS[name].read(path)
        except SonocalError as error:
            assert "\n" not in str(error), f"more than one line: {error}"

    where = [str(seeds), f"-artifact_prefix={folder}/", f"-max_total_time={seconds}"]
    atheris.Setup([sys.argv[0], *LIMITS, *where], target)
    atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())
