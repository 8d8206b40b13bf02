"""What links a module for macOS on Linux: LLVM's linker, zig's libc++ and its list of what macOS has."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Mapping
from pathlib import Path

from debian import unpacked
from targets import Target
from tools import WORK, WheelError, run, zig

__all__ = ["linker_variables"]

LINKERS = ("ld64.lld", "ld64.lld-21", "ld64.lld-20", "ld64.lld-19")


def linker_variables(target: Target, cache: Path) -> Mapping[str, str]:
    """The variables that `rules.cmake` reads.

    Args:
        target: a macOS.
        cache: zig's, of this target alone; the libraries are found there.
    """
    oldest = target.zig.rpartition("macos.")[2]
    command = [
        *_linker(),
        *("-bundle", "-arch", target.processor, "-platform_version", "macos", oldest, oldest),
        *("-undefined", "dynamic_lookup", "-dead_strip", "-x", "-S", "-adhoc_codesign"),
        *("-exported_symbol", "_PyInit__core"),  # others macOS would share with another module's of that name
    ]
    libraries = [*_libraries(target, cache), _system()]
    return {
        "SONOCAL_LD64": shlex.join(command),
        "SONOCAL_LD64_LIBRARIES": shlex.join(map(str, libraries)),
    }


def _linker() -> list[str]:
    for name in LINKERS:
        if found := shutil.which(name):
            return [found]
    return unpacked("trixie", "amd64", "lld-19").command("usr/bin/ld64.lld-19")


def _libraries(target: Target, cache: Path) -> list[Path]:
    """libc++ as zig builds it when it first links for a target."""
    source, program = cache / "first.cpp", cache / "first.dylib"
    cache.mkdir(parents=True, exist_ok=True)
    source.write_text("#include <string>\nstd::string first(int n) { return std::string(n, 'x'); }\n")
    run(
        [zig(), "c++", "-target", target.zig, "-shared", source, "-o", program],
        {"ZIG_GLOBAL_CACHE_DIR": str(cache), "ZIG_LOCAL_CACHE_DIR": str(cache)},
    )
    found = [next(cache.glob(f"o/*/{name}.a"), None) for name in ("libc++", "libc++abi", "libcompiler_rt")]
    if None in found:
        raise WheelError(f"zig left no libc++ in {cache}; remove that folder and try again")
    return [path for path in found if path]


def _system() -> Path:
    """Zig's list of libSystem, without the processors that LLVM 19 has not heard of."""
    text = zig().with_name("lib").joinpath("libc/darwin/libSystem.tbd").read_text()
    path = WORK / "headers" / "libSystem.tbd"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        text.replace("arm64e.x1-macos,", "")
        .replace("arm64e.x1-macos", "")
        .replace("arm64e.x1-maccatalyst", "")
    )
    return path
