"""CPythons of this machine, and virtual environments of them that build wheels."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

from targets import FLOOR, STABLE

__all__ = ["ROOT", "WORK", "WheelError", "host", "packages", "run", "tools", "zig"]

ROOT = Path(__file__).resolve().parents[2]
WORK = ROOT / "build" / "wheels"
"""Where everything lies that is made on the way."""


class WheelError(Exception):
    """What is missing or went wrong, in a sentence."""


def run(
    command: Sequence[str | Path],
    env: Mapping[str, str] | None = None,
    cwd: Path = ROOT,
    log: Path | None = None,
) -> str:
    """What a command prints.

    Args:
        command: the program and its arguments.
        env: variables to add to this process's.
        cwd: the folder it runs in.
        log: what it prints is also kept there.

    Raises:
        WheelError: it failed; with the end of what it said.
    """
    done = subprocess.run(
        [str(part) for part in command],
        env=os.environ | dict(env or {}),
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        errors="replace",
        check=False,
    )
    if log:
        log.parent.mkdir(parents=True, exist_ok=True)
        log.write_text(done.stdout)
    if done.returncode:
        last = "\n".join(done.stdout.splitlines()[-25:])
        raise WheelError(
            f"{' '.join(str(part) for part in command)[:300]}\n{last}\nfailed with {done.returncode}"
        )
    return done.stdout


@cache
def host(version: tuple[int, int]) -> Path:
    """A CPython of this machine: of that version, or for the stable ABI of that or a later one, with its headers.

    Raises:
        WheelError: there is none.
    """
    minors = [version[1]] if version < STABLE else range(version[1], version[1] + 4)
    for python in (found for minor in minors for found in _named(f"python3.{minor}")):
        if _has_headers(python):
            return python
    later = "" if version < STABLE else " or a later one"
    raise WheelError(
        f"wheels for CPython {version[0]}.{version[1]} need that version{later} on this machine, with its "
        f"headers (Debian: apt install python3-dev; or pyenv, uv); found none, nor in ~/.pyenv"
    )


def _named(name: str) -> Iterator[Path]:
    if on_path := shutil.which(name):
        yield Path(on_path)
    yield from sorted(Path.home().glob(f".pyenv/versions/*/bin/{name}"))


def _has_headers(python: Path) -> bool:
    code = "import sysconfig; print(sysconfig.get_config_h_filename())"
    try:
        return Path(run([python, "-c", code]).strip()).is_file()
    except WheelError:  # such as pyenv's shim of a version that is not chosen
        return False


@cache
def tools() -> Path:
    """A virtual environment with what builds and inspects wheels (`wheels` of the dependency groups).

    Returns:
        Its Python.
    """
    folder = WORK / "tools"
    python = folder / "bin" / "python"
    if not python.exists():
        print("installing the tools", file=sys.stderr)
        run([host(STABLE), "-m", "venv", folder])
        run([python, "-m", "pip", "install", "--quiet", "pip>=25.1"])
    run([python, "-m", "pip", "install", "--quiet", "--group", "wheels"])
    return python


@cache
def packages() -> Path:
    """The folder with the tools' packages: those that build are of Python alone, and serve any CPython."""
    return Path(run([tools(), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]).strip())


def zig() -> Path:
    """The compiler, from its Python package."""
    return packages() / "ziglang" / "zig"


assert FLOOR < STABLE
