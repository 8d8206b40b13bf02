"""The picture of the rooms and their table in docs/architecture.md, made from scripts/check_imports.py.

python -m docs.draw_rooms
"""

from __future__ import annotations

import ast
from itertools import pairwise, permutations
from pathlib import Path

from scripts.check_imports import EVERYONE, FACE, ROOMS, SOURCE

PAGE = Path(__file__).parent / "architecture.md"
PICTURE = Path(__file__).parent / "pictures" / "rooms.svg"
START, END = "<!-- rooms: written by docs/draw_rooms.py -->\n", "<!-- end of rooms -->\n"

WIDTH, ROW, BOX_W, BOX_H, BEND_W, MARGIN = 760, 82, 150, 36, 20, 20
# A room, or a bend of an arrow from one room to another in a row between them.
Node = str | tuple[str, str, int]
Links = list[tuple[Node, Node]]
STYLE = """
  .ground { fill: #ffffff } .box { fill: #eef3f8; stroke: #4a6785 } .bar { fill: #f6f1e4; stroke: #8a7443 }
  text { fill: #1c2733; font: 14px system-ui, sans-serif; text-anchor: middle } .small { font-size: 12px }
  .arrow { stroke: #4a6785; stroke-width: 1.4; fill: none } .head { fill: #4a6785 }
  @media (prefers-color-scheme: dark) {
    .ground { fill: #14191f } .box { fill: #223041; stroke: #8fb0d1 } .bar { fill: #353022; stroke: #cbb67c }
    text { fill: #e6edf4 } .arrow { stroke: #8fb0d1 } .head { fill: #8fb0d1 }
  }"""


def main() -> None:
    """Write both."""
    PICTURE.write_text(picture(), encoding="utf-8")
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


def with_table(text: str) -> str:
    """The page with the table between its marks."""
    above, _, rest = text.partition(START)
    below = rest.partition(END)[2]
    return f"{above}{START}\n{table()}\n\n{END}{below}"


def table() -> str:
    """One row a room, from the top of the house down; what it is for is the first sentence of its own docstring."""
    rows = ["| room | what it is | may import |", "|---|---|---|"]
    for room, may in ROOMS.items():
        if room == "__main__":
            continue
        order = list(ROOMS)
        names = (
            ", ".join(f"`{name}`" for name in sorted(may, key=order.index))
            if "*" not in may
            else "everything below"
        )
        rows.append(f"| `{room}` | {purpose(room)} | {names or 'nothing'} |")
    everyone = ", ".join(f"`{name}`" for name in sorted(EVERYONE))
    return "\n".join(
        [
            *rows,
            "",
            f"Every room may also import {everyone}; of these `files` and `geometry` import `errors`.",
        ]
    )


def purpose(room: str) -> str:
    """The first sentence of a room's docstring."""
    place = SOURCE / Path(*room.split("."))
    found = (place / f"{FACE}.py", place.with_suffix(".py"), place.with_suffix(".pyi"))
    path = next(path for path in found if path.exists())
    words = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return words.split("\n\n")[0].replace("\n", " ").split(". ")[0].rstrip(".")


def needed() -> dict[str, set[str]]:
    """The arrows of the table without those that others imply, the foundation and the rooms that may everything."""
    drawn = [
        room for room, may in ROOMS.items() if room not in EVERYONE and "*" not in may and room != "__main__"
    ]
    direct = {room: ROOMS[room] & set(drawn) for room in drawn}

    def below(room: str) -> set[str]:
        return direct[room].union(*(below(other) for other in direct[room]))

    return {room: may - set().union(*(below(other) for other in may)) for room, may in direct.items()}


def rows_of(links: Links, levels: dict[Node, int]) -> list[list[Node]]:
    """Rooms and bends by how many rooms stand below them, top row first, ordered so that arrows are short."""
    rows = [[node for node in levels if levels[node] == one] for one in range(max(levels.values()), -1, -1)]

    def length(rows: list[list[Node]]) -> float:
        x = places(rows)
        return sum((x[upper] - x[lower]) ** 2 for upper, lower in links)

    for _ in range(6):
        for index in range(len(rows)):
            tried = ([*rows[:index], list(row), *rows[index + 1 :]] for row in permutations(rows[index]))
            rows = min(tried, key=length)
    return rows


def bent(arrows: dict[str, set[str]]) -> tuple[Links, dict[Node, int]]:
    """Arrows in pieces of one row each, and the rows: a long one has a bend in each row that it passes."""

    def level(room: str) -> int:
        return 1 + max((level(other) for other in arrows[room]), default=-1)

    levels: dict[Node, int] = {room: level(room) for room in arrows}
    links: Links = []
    for room, other in ((room, other) for room, may in arrows.items() for other in sorted(may)):
        bends = [(room, other, row) for row in range(levels[room] - 1, levels[other], -1)]
        levels |= {bend: bend[2] for bend in bends}
        links += pairwise([room, *bends, other])
    return links, levels


def places(rows: list[list[Node]]) -> dict[Node, float]:
    """The middle of each, px: a row is spread over the width."""
    middles = {}
    for row in rows:
        widths = [BOX_W if isinstance(node, str) else BEND_W for node in row]
        space = (WIDTH - 2 * MARGIN - sum(widths)) / (len(row) + 1)
        left = MARGIN + space
        for node, width in zip(row, widths, strict=True):
            middles[node] = left + width / 2
            left += width + space
    return middles


def picture() -> str:
    """The SVG; it brings its own ground, and other colours where the viewer's page is dark."""
    links, levels = bent(needed())
    rows = rows_of(links, levels)
    height = MARGIN + ROW * (len(rows) + 2) - (ROW - BOX_H) + MARGIN
    top = {node: MARGIN + ROW * (1 + index) for index, row in enumerate(rows) for node in row}
    middle = places(rows)
    parts = [bar(MARGIN, "cli, cli.screen", "may import everything below")]
    for upper, lower in links:
        parts.append(
            arrow(middle[upper], top[upper] + BOX_H, middle[lower], top[lower], isinstance(lower, str))
        )
    for node, y in top.items():
        parts.append(box(middle[node], y, node) if isinstance(node, str) else through(middle[node], y))
    parts.append(
        bar(MARGIN + ROW * (len(rows) + 1), ", ".join(sorted(EVERYONE)), "every room may import these")
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img">\n'
        f"<title>The rooms of sonocal: arrows lead from a room to what it imports</title>\n<style>{STYLE}\n</style>\n"
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path class="head" d="M0 0 L8 4 L0 8 z"/></marker></defs>\n'
        f'<rect class="ground" width="{WIDTH}" height="{height}"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


def bar(y: float, names: str, says: str) -> str:
    return (
        f'<rect class="bar" x="{MARGIN}" y="{y}" width="{WIDTH - 2 * MARGIN}" height="{BOX_H}" rx="6"/>'
        f'<text x="{WIDTH / 2}" y="{y + 16}">{names}</text>'
        f'<text class="small" x="{WIDTH / 2}" y="{y + 30}">{says}</text>'
    )


def box(x: float, y: float, name: str) -> str:
    return (
        f'<rect class="box" x="{x - BOX_W / 2:.0f}" y="{y}" width="{BOX_W}" height="{BOX_H}" rx="6"/>'
        f'<text x="{x:.0f}" y="{y + 23}">{name}</text>'
    )


def through(x: float, y: float) -> str:
    return f'<path class="arrow" d="M{x:.0f} {y} V{y + BOX_H}"/>'


def arrow(x0: float, y0: float, x1: float, y1: float, head: bool) -> str:
    bend = (y1 - y0) / 2
    path = f"M{x0:.0f} {y0:.0f} C{x0:.0f} {y0 + bend:.0f} {x1:.0f} {y1 - bend:.0f} {x1:.0f} {y1:.0f}"
    end = ' marker-end="url(#head)"' if head else ""
    return f'<path class="arrow"{end} d="{path}"/>'


if __name__ == "__main__":
    main()
