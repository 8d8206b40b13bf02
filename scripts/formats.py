"""Put the table of formats into docs/formats.md, as the registry has it: run it after adding a format."""

from __future__ import annotations

from pathlib import Path

DOCS = Path(__file__).parent.parent / "docs" / "formats.md"
START, END = "<!-- formats: written by scripts/formats.py -->\n", "<!-- end of formats -->\n"


def main() -> None:
    """Write the table."""
    DOCS.write_text(with_table(DOCS.read_text(encoding="utf-8")), encoding="utf-8")


def with_table(text: str) -> str:
    """The page with the registry's table between its marks."""
    from sonocal.cli.formats import table

    above, _, rest = text.partition(START)
    _, _, below = rest.partition(END)
    return f"{above}{START}\n{table()}\n\n{END}{below}"


if __name__ == "__main__":
    main()
