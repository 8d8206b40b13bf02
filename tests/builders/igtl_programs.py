"""Programs of others that speak OpenIGTLink, each a process that ends with the test."""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from sonocal import InputError, igtl

EXAMPLES = Path("/usr/share/doc/openigtlink-examples/examples")
HEADERS = Path("/usr/include/openigtlink")
COMPILER = shutil.which("c++")
IMAGES = EXAMPLES / "Imager" / "img"
START_S = 30.0
BUILD_S = 300.0


class Examples:
    """The library's own examples, which Debian ships as sources: compiled when they are asked for."""

    def __init__(self, folder: Path) -> None:
        if not (EXAMPLES.is_dir() and HEADERS.is_dir() and COMPILER):
            pytest.skip("no OpenIGTLink; apt install libopenigtlink-dev openigtlink-examples g++")
        self._folder = folder

    def program(self, name: str) -> Path:
        """An example by the name of its folder and of itself, such as "Tracker/TrackerServer"."""
        path = self._folder / Path(name).name
        if not path.exists():
            source = EXAMPLES / f"{name}.cxx"
            command = [str(COMPILER), "-w", "-O0", f"-I{HEADERS}", str(source), "-o", str(path)]
            subprocess.run([*command, "-lOpenIGTLink", "-lpthread"], check=True, timeout=BUILD_S)
        return path


def free_port() -> int:
    """One that nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


@contextmanager
def running(*command: str | Path, says: Path | None = None) -> Iterator[subprocess.Popen[str]]:
    """A process that is gone when the block ends; what it says to people goes into a file."""
    with (says or Path("/dev/null")).open("w") as log:
        process = subprocess.Popen(
            [str(part) for part in command],
            stdin=subprocess.PIPE,
            stdout=log if says else subprocess.PIPE,
            stderr=log,
            text=True,
        )
        try:
            yield process
        finally:
            process.kill()
            process.communicate()


def python(script: str) -> tuple[str, ...]:
    """The command that runs a script of Python."""
    return sys.executable, "-c", script


@contextmanager
def client_of(port: int) -> Iterator[igtl.Client]:
    """A client of a server that is still starting."""
    until = time.monotonic() + START_S
    while True:
        try:
            client = igtl.Client("127.0.0.1", port)
            break
        except InputError:
            if time.monotonic() > until:
                raise
            time.sleep(0.05)
    with client:
        yield client
