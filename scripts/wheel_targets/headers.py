"""CPython's headers and import libraries for other machines, from those of this one."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from targets import STABLE, Target
from tools import WORK, host, run, tools, zig

__all__ = ["import_libraries", "include_folder"]

# Names that a header declares for other programs: functions, and data.
DECLARED = re.compile(r"PyAPI_(?:FUNC|DATA)\s*\([^)]*\)\s*\**\s*(?P<name>\w+)")


def include_folder(target: Target, version: tuple[int, int]) -> Path:
    """CPython's headers with a `pyconfig.h` of the target: ours for Windows, else that of this machine.

    A Linux and a macOS of 64 bits agree in all of it that the interface depends on: sizes, threads, no debugging.
    """
    folder = WORK / "headers" / f"{target.system}-{version[0]}.{version[1]}"
    code = (
        "import sysconfig; print(sysconfig.get_path('include'), sysconfig.get_config_h_filename(), sep='\\n')"
    )
    own, config = map(Path, run([host(version), "-c", code]).split())
    if not folder.exists():
        shutil.copytree(own, folder)
    if target.system == "Windows":
        config = Path(__file__).with_name("pyconfig.h")
    shutil.copyfile(config, folder / "pyconfig.h")
    return folder


def import_libraries(version: tuple[int, int]) -> dict[str, Path]:
    """The libraries that tell Windows' linker what CPython's DLLs have, as CMake calls them.

    CMake wants that of the headers' own version, too, where a module of the stable ABI is linked.
    """
    code = "import sys; print('python%d%d' % sys.version_info[:2])"
    full = _library(run([host(version), "-c", code]).strip(), _declared_names(version))
    return {"Python_LIBRARY": full, "Python_SABI_LIBRARY": _library("python3", _stable_names())}


def _library(name: str, names: list[str]) -> Path:
    folder = WORK / "headers"
    definition, library = folder / f"{name}.def", folder / f"lib{name}.a"
    definition.write_text(f"LIBRARY {name}.dll\nEXPORTS\n" + "".join(f"    {one}\n" for one in names))
    run([zig(), "dlltool", "-m", "i386:x86-64", "-d", definition, "-l", library])
    return library


def _stable_names() -> list[str]:
    code = (
        "import abi3info, itertools\n"
        "for s in itertools.chain(abi3info.FUNCTIONS.values(), abi3info.DATAS.values()):\n"
        "    if not s.ifdef or 'windows' in str(s.ifdef).lower():\n"
        f"        if (s.added.major, s.added.minor) <= {STABLE}: print(s.symbol.name)\n"
    )
    return sorted(run([tools(), "-c", code]).split())


def _declared_names(version: tuple[int, int]) -> list[str]:
    code = "import sysconfig; print(sysconfig.get_path('include'))"
    folder = Path(run([host(version), "-c", code]).strip())
    texts = (header.read_text(errors="replace") for header in folder.rglob("*.h"))
    return sorted({name for text in texts for name in DECLARED.findall(text)})
