"""Build the documentation's site without a network, and follow every link inside: pages, anchors, pictures, codes.

python scripts/check_site.py [FOLDER]
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

DOCS = Path(__file__).parent.parent / "docs"


class Page(HTMLParser):
    """What a page links to, and what can be linked to in it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id" and value:
                self.anchors.add(value)
            elif name in ("href", "src") and value:
                self.links.add(value)


def main() -> None:
    """Build, check, say what is broken."""
    with tempfile.TemporaryDirectory() as scratch:
        site = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch) / "site"
        build = [
            "-q",
            "-W",
            "--keep-going",
            "-j",
            "auto",
            "-d",
            f"{scratch}/trees",
            "-b",
            "html",
            str(DOCS),
            str(site),
        ]
        subprocess.run([sys.executable, "-m", "sphinx", *build], check=True)
        wrong = broken_links(site)
    if wrong:
        sys.exit("\n".join(wrong))


def broken_links(site: Path) -> list[str]:
    """Links inside that lead nowhere, and codes of findings without an anchor."""
    from sonocal.findings import CODES, REASONS, REFUSALS

    pages = {path: Page(path) for path in sorted(site.rglob("*.html"))}
    wrong = [f"{path.relative_to(site)}: {link}" for path in pages for link in broken(path, pages)]
    anchors = pages[site / "findings.html"].anchors
    return wrong + [f"findings.html has no #{code}" for code in {*CODES, *REFUSALS, *REASONS} - anchors]


def broken(path: Path, pages: dict[Path, Page]) -> Iterator[str]:
    """Of one page."""
    for link in sorted(pages[path].links):
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        page = pages.get(target)
        if not target.exists() or (page and parts.fragment and unquote(parts.fragment) not in page.anchors):
            yield link


if __name__ == "__main__":
    main()
