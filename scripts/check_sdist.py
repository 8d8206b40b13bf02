"""Builds the sdist and says what it lacks of the tree, holds beside it, or holds otherwise.

    python scripts/check_sdist.py FOLDER

Exit status 1 where it is not the tree that git knows.
"""

from __future__ import annotations

import subprocess
import sys
import tarfile
from pathlib import Path

from scikit_build_core.build import build_sdist

NOT_FOR_USERS = (".ci/", ".github/")
MADE = {"PKG-INFO"}


def held(archive: Path) -> dict[str, bytes]:
    """The files of an sdist, by their names below its one folder."""
    with tarfile.open(archive) as file:
        return {
            member.name.partition("/")[2]: content.read()
            for member in file
            if (content := file.extractfile(member)) is not None
        }


def wanted() -> set[str]:
    """Names of the files that git knows."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        capture_output=True,
        text=True,
        check=True,
    )
    names = {name for name in listed.stdout.split("\0") if name and Path(name).is_file()}
    return {name for name in names if not name.startswith(NOT_FOR_USERS)}


def main(folder: str) -> int:
    """Build it, and count what is wrong."""
    archive = Path(folder, build_sdist(folder))
    contents, tree = held(archive), wanted()
    there = contents.keys() - MADE
    wrong = [f"lacks {name}" for name in sorted(tree - there)]
    wrong += [f"holds {name}" for name in sorted(there - tree)]
    wrong += [
        f"holds another {name}" for name in sorted(there & tree) if contents[name] != Path(name).read_bytes()
    ]
    for sentence in wrong:
        print(f"{archive.name}: {sentence}", file=sys.stderr)
    print(f"{archive.name}: {len(there)} files, {archive.stat().st_size / 1e6:.1f} MB")
    return len(wrong)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]) > 0)
