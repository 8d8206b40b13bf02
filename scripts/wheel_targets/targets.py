"""The five kinds of machine that wheels are made for, as data."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FLOOR", "STABLE", "TARGETS", "Target"]

FLOOR = (3, 11)
"""The oldest CPython: it has no stable ABI that nanobind could use, and gets wheels of its own."""
STABLE = (3, 12)
"""The oldest CPython of the stable ABI: one wheel for it and all later ones."""


@dataclass(frozen=True)
class Target:
    """A kind of machine, in the words of zig, of CMake and of wheels."""

    zig: str
    system: str
    processor: str
    platform: str  # of the wheel's tag
    suffix: str  # of the module for CPython 3.11, without the file's ending

    def tag(self, version: tuple[int, int]) -> str:
        """The wheel's tag for a CPython."""
        python = f"cp{version[0]}{version[1]}"
        return f"{python}-{python if version < STABLE else 'abi3'}-{self.platform}"

    def module(self, version: tuple[int, int]) -> str:
        """The file name of the core in that wheel."""
        ending = "pyd" if self.system == "Windows" else "so"
        if version < STABLE:
            return f"_core.{self.suffix}.{ending}"
        return f"_core.{ending}" if self.system == "Windows" else f"_core.abi3.{ending}"


TARGETS = {
    "linux-x86_64": Target(
        "x86_64-linux-gnu.2.17",
        "Linux",
        "x86_64",
        "manylinux_2_17_x86_64",
        "cpython-311-x86_64-linux-gnu",
    ),
    "linux-arm64": Target(
        "aarch64-linux-gnu.2.17",
        "Linux",
        "aarch64",
        "manylinux_2_17_aarch64",
        "cpython-311-aarch64-linux-gnu",
    ),
    "windows-x86_64": Target("x86_64-windows-gnu", "Windows", "AMD64", "win_amd64", "cp311-win_amd64"),
    # The first macOS of such processors.
    "macos-arm64": Target("aarch64-macos.11.0", "Darwin", "arm64", "macosx_11_0_arm64", "cpython-311-darwin"),
    # The first that has aligned_alloc, which operator new of libc++ calls.
    "macos-x86_64": Target(
        "x86_64-macos.10.15", "Darwin", "x86_64", "macosx_10_15_x86_64", "cpython-311-darwin"
    ),
}
