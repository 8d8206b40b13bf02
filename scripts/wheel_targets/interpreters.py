"""CPythons that wheels can be run with: this machine's own, and Debian's for it and for arm64 under emulation."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from debian import unpacked
from targets import TARGETS
from tools import WheelError, host

__all__ = ["VERSIONS", "Interpreter", "interpreters"]

VERSIONS = ("3.11", "3.12", "3.13", "3.14")
# Debian's releases have one each.
RELEASES = {(3, 11): "bookworm", (3, 13): "trixie", (3, 14): "forky"}
MACHINES = {"linux-x86_64": "amd64", "linux-arm64": "arm64"}


@dataclass(frozen=True)
class Interpreter:
    """A CPython, and how it is started here."""

    target: str
    version: tuple[int, int]
    command: tuple[str, ...]
    origin: str

    @property
    def tests_are_worth_it(self) -> bool:
        """Under emulation they take ten times as long: one CPython of each machine is enough then."""
        return self.target != "linux-arm64" or self.version == (3, 13)

    @property
    def platforms(self) -> list[str]:
        """Tags of wheels that it takes, of other packages, too."""
        machine = TARGETS[self.target].processor
        return [f"manylinux_2_{minor}_{machine}" for minor in (28, 27, 24, 17)] + [f"manylinux2014_{machine}"]


def interpreters(targets: Iterable[str], versions: Iterable[str]) -> Iterator[Interpreter | str]:
    """All that can be had for some targets, of some of `VERSIONS`; for others, why not."""
    minors = [int(version.removeprefix("3.")) for version in versions]
    for target in targets:
        if target not in MACHINES:
            yield f"{target}: not run, there is no such system here; its wheels are looked into"
        elif target == "linux-arm64" and not shutil.which("qemu-aarch64-static"):
            yield f"{target}: not run, qemu-aarch64-static is missing (Debian: apt install qemu-user-static)"
        else:
            yield from (_found(target, (3, minor)) for minor in minors)


def _found(target: str, version: tuple[int, int]) -> Interpreter | str:
    name = f"python{version[0]}.{version[1]}"
    try:
        if target == "linux-x86_64" and (own := _own(name, version)):
            return Interpreter(target, version, (str(own),), "of this machine")
        if version not in RELEASES:
            return f"{target}: not run on CPython {version[0]}.{version[1]}, of which Debian has none"
        release = RELEASES[version]
        root = unpacked(release, MACHINES[target], name, "libstdc++6")  # which NumPy needs
    except (WheelError, OSError) as error:
        return f"{target}: not run on CPython {version[0]}.{version[1]} ({str(error).splitlines()[-1]})"
    return Interpreter(target, version, tuple(root.command(f"usr/bin/{name}")), f"Debian {release}")


def _own(name: str, version: tuple[int, int]) -> Path | None:
    try:
        found = host(version)
    except WheelError:
        return None
    return found if found.name == name else None
