"""Looks into wheels: size, tag, what the core asks of CPython and of the system. Runs with the tools' Python.

    python look.py WHEEL...

Prints a line a wheel, and every fault; exit status 1 where there is one.
"""

from __future__ import annotations

import itertools
import re
import sys
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import abi3info
import lief

from targets import FLOOR, STABLE, TARGETS, Target

# Bytes. Half of a wheel is the Python of all rooms, which grows with what is built; the module must not grow with it.
LARGEST, LARGEST_MODULE = 2_000_000, 900_000
OF_PYTHON = re.compile(r"_?Py[A-Z_]\w*")
# What manylinux2014, macOS and Windows have by themselves.
LIBRARIES = {
    "Linux": re.compile(r"lib(c|m|pthread|dl|rt)\.so\.\d|ld-linux-[\w-]+\.so\.\d"),
    "Darwin": re.compile(r"/usr/lib/libSystem\.B\.dylib"),
    "Windows": re.compile(r"python3(11)?\.dll|KERNEL32\.dll|ntdll\.dll|api-ms-win-crt-[\w-]+\.dll"),
}
MACHINES = {
    "linux-x86_64": lief.ELF.ARCH.X86_64,
    "linux-arm64": lief.ELF.ARCH.AARCH64,
    "windows-x86_64": lief.PE.Header.MACHINE_TYPES.AMD64,
    "macos-arm64": lief.MachO.Header.CPU_TYPE.ARM64,
    "macos-x86_64": lief.MachO.Header.CPU_TYPE.X86_64,
}


@dataclass
class Core:
    """What a compiled module says of itself."""

    machine: object
    imported: set[str]
    exported: set[str]
    libraries: set[str]
    oldest: str  # the system that it says it needs
    faults: list[str] = field(default_factory=list)


def read_core(content: bytes, name: str) -> Core:
    """A module of any of the three systems."""
    parsed = lief.parse(content)
    if isinstance(parsed, lief.ELF.Binary):
        return _elf(parsed)
    if isinstance(parsed, lief.PE.Binary):
        return _pe(parsed)
    if isinstance(parsed, lief.MachO.Binary):
        return _macho(parsed)
    raise SystemExit(f"{name}: is no module that a system loads")


def _elf(core: lief.ELF.Binary) -> Core:
    versions = [
        auxiliary.name
        for needed in core.symbols_version_requirement
        for auxiliary in needed.get_auxiliary_symbols()
        if auxiliary.name.startswith("GLIBC_")
    ]
    newest = max(versions, key=_numbers, default="GLIBC_0")
    imported = {str(symbol.name) for symbol in core.dynamic_symbols if symbol.shndx == 0}
    exported = {str(symbol.name) for symbol in core.exported_symbols}
    return Core(core.header.machine_type, imported, exported, set(map(str, core.libraries)), newest)


def _pe(core: lief.PE.Binary) -> Core:
    imported = {str(entry.name) for library in core.imports for entry in library.entries}
    exported = {str(entry.name) for entry in core.get_export().entries}
    header = core.optional_header
    oldest = f"Windows {header.major_subsystem_version}.{header.minor_subsystem_version}"
    libraries = {str(library.name) for library in core.imports}
    if any(library.startswith("api-ms-win-crt") for library in libraries):
        oldest = "Windows 10"  # the first that has the universal C library by itself
    return Core(core.header.machine, imported, exported, libraries, oldest)


def _macho(core: lief.MachO.Binary) -> Core:
    plain = [
        {str(s.name).removeprefix("_") for s in symbols}
        for symbols in (core.imported_symbols, core.exported_symbols)
    ]
    build = core.build_version
    oldest = "macOS " + ".".join(map(str, build.minos[:2]))
    found = Core(core.header.cpu_type, *plain, {str(library.name) for library in core.libraries}, oldest)
    # Those of CPython are looked for in the program that loads it; any other name must be of a library.
    flat = {
        str(s.name).removeprefix("_")
        for s in core.imported_symbols
        if s.has_binding_info and not s.binding_info.has_library
    }
    if stray := {name for name in flat if not OF_PYTHON.fullmatch(name)}:
        found.faults.append(f"of no library: {', '.join(sorted(stray))}")
    return found


def _numbers(name: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", name))


def stable_names(version: tuple[int, int]) -> set[str]:
    """Names of the stable ABI of a CPython."""
    known = itertools.chain(abi3info.FUNCTIONS.values(), abi3info.DATAS.values())
    return {one.symbol.name for one in known if (one.added.major, one.added.minor) <= version}


def exported_names(program: Path) -> set[str]:
    """Names that a CPython of this machine offers to modules."""
    parsed = lief.parse(str(program))  # must outlive its symbols
    return {str(symbol.name) for symbol in parsed.exported_symbols}


def faults(wheel: Path, target_name: str, version: tuple[int, int], offered: set[str]) -> Iterator[str]:
    """What is wrong with a wheel.

    Args:
        wheel: the file.
        target_name: of TARGETS.
        version: the CPython of its tag.
        offered: names that a module may ask of it.
    """
    target = TARGETS[target_name]
    if (size := wheel.stat().st_size) > LARGEST:
        yield f"has {size} bytes, more than {LARGEST}"
    with zipfile.ZipFile(wheel) as archive:
        modules = [
            name
            for name in archive.namelist()
            if name.endswith((".so", ".pyd", ".dll", ".dylib", ".o", ".a"))
        ]
        if (packed := sum(archive.getinfo(name).compress_size for name in modules)) > LARGEST_MODULE:
            yield f"has a module of {packed} bytes, packed, more than {LARGEST_MODULE}"
        if modules != [f"sonocal/{target.module(version)}"]:
            yield f"holds {', '.join(modules)} and not {target.module(version)} alone"
            return
        core = read_core(archive.read(modules[0]), wheel.name)
    yield from core.faults
    if core.machine != MACHINES[target_name]:
        yield f"is for {core.machine}"
    if core.exported & {"PyInit__core"} == set():
        yield "exports no PyInit__core"
    if foreign := {name for name in core.libraries if not LIBRARIES[target.system].fullmatch(name)}:
        yield f"needs {', '.join(sorted(foreign))}"
    asked = {name for name in core.imported if OF_PYTHON.fullmatch(name)}
    if unknown := asked - offered:
        yield f"asks CPython for {', '.join(sorted(unknown))}"
    if not asked:
        yield "asks nothing of CPython"
    yield from _system_faults(target, core)
    print(f"{wheel.name}: {size / 1e6:.2f} MB, {core.oldest}, {len(asked)} names of CPython")


def _system_faults(target: Target, core: Core) -> Iterator[str]:
    told = re.search(r"_(\d+_\d+)_", target.platform)
    if target.system != "Windows" and told and _numbers(core.oldest)[-2:] > _numbers(told[1]):
        yield f"needs {core.oldest}, and its tag says {told[1].replace('_', '.')}"


def main(wheels: list[Path]) -> int:
    """Look into wheels, and count the faults."""
    count = 0
    by_tag = {target.tag(v): (name, v) for name, target in TARGETS.items() for v in (FLOOR, STABLE)}
    floor = exported_names(Path(sys.argv[1]))
    for wheel in wheels:
        tag = wheel.stem.split("-", 2)[2]
        if tag not in by_tag:
            found = ["its tag is of no target"]
        else:
            name, version = by_tag[tag]
            found = list(faults(wheel, name, version, floor if version < STABLE else stable_names(version)))
        for fault in found:
            print(f"{wheel.name}: {fault}", file=sys.stderr)
        count += len(found)
    return count


if __name__ == "__main__":
    sys.exit(main([Path(name) for name in sys.argv[2:]]) > 0)
