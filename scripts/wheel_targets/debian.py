"""Packages of Debian, of any of its releases and machines, unpacked into a folder: nothing is installed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tools import WORK, WheelError, run

__all__ = ["Root", "unpacked"]

TRIPLETS = {"amd64": "x86_64-linux-gnu", "arm64": "aarch64-linux-gnu"}
LOADERS = {"amd64": "lib64/ld-linux-x86-64.so.2", "arm64": "lib/ld-linux-aarch64.so.1"}


@dataclass(frozen=True)
class Root:
    """A folder with programs and all libraries that they need."""

    folder: Path
    machine: str

    def command(self, program: str) -> list[str]:
        """How a program of it is started here: with its own libraries, under emulation where it must be."""
        loader, path = self.folder / LOADERS[self.machine], self.folder / program
        if self.machine == "arm64":
            return ["qemu-aarch64-static", "-L", str(self.folder), str(path)]
        libraries = self.folder / "usr" / "lib" / TRIPLETS[self.machine]
        return [str(loader), "--library-path", str(libraries), str(path)]


def unpacked(release: str, machine: str, *packages: str) -> Root:
    """Packages with all that they depend on, from where this machine's apt gets its own.

    Args:
        release: such as "trixie".
        machine: "amd64" or "arm64".
        packages: their names.

    Raises:
        WheelError: this is no Debian, or its archive has no such package.
    """
    root = WORK / "debian" / f"{release}-{machine}-{packages[0]}"
    done = root / "done"
    if not done.exists():
        _download(root, release, machine, packages)
        for package in sorted((root / "cache" / "archives").glob("*.deb")):
            run(["dpkg", "-x", package, root / "root"])
        for merged in ("bin", "lib", "lib64", "sbin"):  # the links that Debian's base files would make
            link = root / "root" / merged
            if not (link.exists() or link.is_symlink()):  # one that leads nowhere is there, too
                link.symlink_to(f"usr/{merged}")
        done.touch()
    return Root(root / "root", machine)


def _download(root: Path, release: str, machine: str, packages: tuple[str, ...]) -> None:
    for folder in ("lists/partial", "cache/archives/partial"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    (root / "status").touch()  # of a machine that has nothing installed
    (root / "sources.list").write_text(f"deb {_archive()} {release} main\n")
    options = {
        "Dir::Etc::sourcelist": root / "sources.list",
        "Dir::Etc::sourceparts": "/dev/null",
        "Dir::State": root,
        "Dir::State::status": root / "status",
        "Dir::Cache": root / "cache",
        "APT::Architecture": machine,
        "APT::Architectures": machine,
        "APT::Sandbox::User": "",
        "Debug::NoLocking": "1",
    }
    apt = [
        "apt-get",
        "--quiet",
        *(part for name, value in options.items() for part in ("-o", f"{name}={value}")),
    ]
    run([*apt, "update"])
    run([*apt, "--yes", "--no-install-recommends", "--download-only", "install", *packages])


def _archive() -> str:
    listed = ["apt-get", "indextargets", "--format", "$(SITE)", "Created-By: Packages", "Component: main"]
    try:
        sites = [site for site in run(listed).split() if site.rstrip("/").endswith("/debian")]
    except OSError:
        sites = []
    if not sites:
        raise WheelError(
            "packages of Debian are needed, and apt of this machine knows no archive of Debian's"
        )
    return sites[0]
