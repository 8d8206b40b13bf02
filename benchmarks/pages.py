"""Tables that a benchmark prints line by line, and the pages that keep them between marks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

__all__ = ["tell", "written"]


def tell(lines: Iterable[tuple[str, str]], page: Path | None) -> None:
    """Print lines as they come, each with the name of its table, and put the tables into a page where one is given."""
    told = []
    for line in lines:
        print(line[1], flush=True)
        told.append(line)
    if page:
        written(page, told)


def written(page: Path, lines: Sequence[tuple[str, str]]) -> None:
    """Replace the tables between a page's markers; those not measured stay."""
    text = page.read_text()
    for part in dict.fromkeys(part for part, _ in lines):
        table = "\n".join(line for of, line in lines if of == part).strip()
        begin, end = f"<!-- {part}: begin -->", f"<!-- {part}: end -->"
        head, rest = text.split(begin)
        text = f"{head}{begin}\n\n{table}\n\n{end}{rest.split(end)[1]}"
    page.write_text(text)
