"""Makes the wheels: for each kind of machine one for CPython 3.11, and one for the stable ABI of 3.12."""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import time
from collections.abc import Mapping
from pathlib import Path

from debian import unpacked
from headers import import_libraries, include_folder
from macos import linker_variables
from targets import FLOOR, STABLE, TARGETS, Target
from tools import ROOT, WORK, WheelError, host, packages, run, tools, zig

Version = tuple[int, int]


def source() -> Path:
    """This tree as the sdist has it: wheels are made from that, and nothing else of the tree comes into them."""
    folder = WORK / "sdist"
    shutil.rmtree(folder, ignore_errors=True)
    run([tools(), "-m", "build", "--sdist", "--no-isolation", "--outdir", folder, ROOT])
    (archive,) = folder.glob("*.tar.gz")
    sources = WORK / "source"
    shutil.rmtree(sources, ignore_errors=True)
    shutil.unpack_archive(archive, folder)
    # The same place for every version, and the files' own times, which an archive that is always the same has not:
    # what changed is compiled again, and nothing else.
    (folder / archive.name.removesuffix(".tar.gz")).rename(sources)
    for path in sources.rglob("*"):
        if (own := ROOT / path.relative_to(sources)).exists():
            shutil.copystat(own, path)
    return sources


def environment(name: str, target: Target, version: Version) -> Mapping[str, str]:
    """The variables that the toolchain and the build backend read."""
    cache = WORK / "zig" / name
    suffix = Path(target.module(version)).suffix
    variables = {
        "PATH": f"{tools().parent}{os.pathsep}{os.environ['PATH']}",
        # One set of tools for both CPythons: with another, all would be compiled again.
        "PYTHONPATH": str(packages()),
        "ZIG_GLOBAL_CACHE_DIR": str(cache),
        "ZIG_LOCAL_CACHE_DIR": str(cache),
        "SONOCAL_ZIG": str(zig()),
        "SONOCAL_ZIG_TARGET": target.zig,
        "SONOCAL_SYSTEM": target.system,
        "SONOCAL_PROCESSOR": target.processor,
        "SETUPTOOLS_EXT_SUFFIX": f".{target.suffix}{suffix}",
    }
    return variables | (linker_variables(target, cache) if target.system == "Darwin" else {})


def definitions(target: Target, version: Version) -> Mapping[str, str | Path]:
    """What CMake must know beside its toolchain."""
    known: dict[str, str | Path] = {
        "CMAKE_TOOLCHAIN_FILE": Path(__file__).with_name("zig.cmake"),
        "SONOCAL_DEMANGLER": "OFF",
        "Python_INCLUDE_DIR": include_folder(target, version),
    }
    if target.system == "Windows":
        known |= import_libraries(version)
        # nanobind would ask this machine's CPython how modules are called.
        known |= {"NB_SUFFIX": f".{target.suffix}.pyd", "NB_SUFFIX_S": ".pyd", "SKBUILD_SOSABI": ""}
    return known


def build(name: str, version: Version, sources: Path, out: Path) -> Path:
    """One wheel."""
    target = TARGETS[name]
    folder = WORK / "wheel" / f"{name}-{version[1]}"
    shutil.rmtree(folder, ignore_errors=True)
    settings = {
        "build-dir": WORK / "build" / name,
        "wheel.tags": target.tag(version),
        **{f"cmake.define.{key}": value for key, value in definitions(target, version).items()},
    }
    options = [part for key, value in settings.items() for part in ("--config-settings", f"{key}={value}")]
    command = [host(version), "-m", "pip", "wheel", "-v", sources, "--no-deps", "--no-build-isolation"]
    log = WORK / "logs" / f"{name}-{version[1]}.txt"
    run([*command, "--wheel-dir", folder, *options], environment(name, target, version), log=log)
    (wheel,) = folder.glob("*.whl")
    run([*_packer(), "--recompress", "--shrink-extra", "--quiet", wheel])
    out.mkdir(exist_ok=True)
    return Path(shutil.copy2(wheel, out))


def _packer() -> list[str]:
    """What packs an archive 3 % tighter than Python does."""
    found = shutil.which("advzip")
    return [found] if found else unpacked("trixie", "amd64", "advancecomp").command("usr/bin/advzip")


def main() -> None:
    """Make the wheels that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)}; all of them")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="the folder that they go to; dist")
    asked = parser.parse_args()
    if unknown := set(asked.targets) - set(TARGETS):
        parser.error(f"{', '.join(sorted(unknown))}: no such target; there are {', '.join(TARGETS)}")
    sources = source()
    for name in asked.targets or TARGETS:
        for version in (STABLE, FLOOR):
            begun = time.monotonic()
            wheel = build(name, version, sources, asked.out)
            seconds = time.monotonic() - begun
            print(f"{wheel.name}  {wheel.stat().st_size / 1e6:.2f} MB  {seconds:.0f} s", flush=True)


if __name__ == "__main__":
    try:
        main()
    except WheelError as error:
        sys.exit(str(error))
