"""What a notebook shows of an object: a card of words, numbers and a small picture, in the page's own colours.

Everything is escaped, nothing is a script, and no style reaches beyond the card. Ink is the page's (``currentColor``),
so that light and dark pages show it alike.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable
from html import escape

import numpy as np

from sonocal.geometry.transforms import Array

__all__ = ["TONES", "card", "dots_svg", "heat_svg", "matrix_html", "png_picture"]

# Of verdicts: legible on white and on black.
TONES = {"use": "#2e9e5b", "care": "#c27c0e", "stop": "#e5534b", "": "currentColor"}
# Of pictures: one hue, more or less of it.
HUE = "#e0823d"
WIDE_PX, MOST_DOTS = 190, 300
# What no page may hold.
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")
BOX = (
    "display:inline-flex;flex-wrap:wrap;gap:1em;align-items:flex-start;max-width:60em;padding:.6em .9em;"
    "border:1px solid rgba(128,128,128,.45);border-radius:6px;text-align:left;line-height:1.4"
)
GRID = "display:grid;grid-template-columns:max-content auto;gap:.1em .9em;margin-top:.4em"


def card(
    head: str,
    text: str = "",
    rows: Iterable[tuple[str, str]] = (),
    *,
    picture: str = "",
    below: str = "",
    tone: str = "",
) -> str:
    """A card.

    Args:
        head: what it is, or the verdict.
        text: a sentence or two.
        rows: names and what they are.
        picture: an element, such as those of this module make.
        below: an element, such as `matrix_html` makes.
        tone: of the head, one of `TONES`.
    """
    cells = "".join(
        f'<span style="opacity:.7">{_text(name)}</span><span>{_text(value)}</span>' for name, value in rows
    )
    words = [
        f'<div style="font-weight:600;color:{TONES.get(tone, TONES[""])}">{_text(head)}</div>',
        f"<div>{_text(text)}</div>" if text else "",
        f'<div style="{GRID}">{cells}</div>' if cells else "",
        below,
    ]
    beside = f'<div style="flex:none">{picture}</div>' if picture else ""
    return f'<div class="sonocal" style="{BOX}"><div style="flex:1;min-width:16em">{"".join(words)}</div>{beside}</div>'


def matrix_html(title: str, matrix: Array) -> str:
    """A matrix below a line that unfolds it."""
    rows = "\n".join(" ".join(f"{x:12.6f}" for x in row) for row in matrix)
    return (
        f'<details style="margin-top:.4em"><summary style="cursor:pointer">{_text(title)}</summary>'
        f'<pre style="margin:.3em 0 0;background:none;color:inherit">{_text(rows)}</pre></details>'
    )


def png_picture(content: bytes, width_px: int, says: str) -> str:
    """A picture from the bytes of its PNG file."""
    data = base64.b64encode(content).decode()
    return f'<img alt="{_text(says)}" width="{width_px}" src="data:image/png;base64,{data}"/>'


def heat_svg(area_px: Array, values: Array, label: str, says: str, box_px: Array | None = None) -> str:
    """Values over an image, u right and v down: the more, the more colour.

    Args:
        area_px: (2, 2): the least and the greatest corner.
        values: (rows, columns), over cells of equal size.
        label: written below.
        says: what is seen, for those who do not see it.
        box_px: (2, 2): an area to draw a dashed line around, or None.
    """
    (left, top), (wide, high) = area_px[0], np.maximum(np.ptp(area_px, axis=0), 1e-9)
    width, height = _fitted(wide, high)
    rows, columns = values.shape
    most = max(float(values.max()), 1e-12)
    cells = "".join(
        f'<rect x="{width * j / columns:.1f}" y="{height * i / rows:.1f}" width="{width / columns + 0.3:.1f}" '
        f'height="{height / rows + 0.3:.1f}" fill="{HUE}" fill-opacity="{0.05 + 0.9 * values[i, j] / most:.2f}"/>'
        for i in range(rows)
        for j in range(columns)
    )
    seen = ""
    if box_px is not None:
        (x0, y0), (x1, y1) = (box_px - [left, top]) / [wide, high] * [width, height]
        seen = (
            f'<rect x="{x0:.1f}" y="{y0:.1f}" width="{max(x1 - x0, 1):.1f}" height="{max(y1 - y0, 1):.1f}" '
            'fill="none" stroke="currentColor" stroke-dasharray="4 3"/>'
        )
    return _svg(width, height, cells + seen, says, label)


def dots_svg(area_px: Array, points_px: Array, says: str) -> str:
    """Points over an image, u right and v down; of many, some."""
    (left, top), (wide, high) = area_px[0], np.maximum(np.ptp(area_px, axis=0), 1e-9)
    width, height = _fitted(wide, high)
    some = points_px[:: -(-len(points_px) // MOST_DOTS) or 1, :2]
    places = (some - [left, top]) / [wide, high] * [width, height]
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.8"/>' for x, y in places)
    return _svg(width, height, f'<g fill="{HUE}">{dots}</g>', says, f"{wide:.0f} x {high:.0f} px")


def _text(words: str) -> str:
    """Words as a page shows them, whatever is in them."""
    return escape(CONTROL.sub("\N{REPLACEMENT CHARACTER}", words))


def _fitted(wide: float, high: float) -> tuple[float, float]:
    """The size of a picture of so wide and so high a thing."""
    shape = float(np.clip(high / wide, 0.3, 1.2))
    return float(WIDE_PX), WIDE_PX * shape


def _svg(width: float, height: float, inside: str, says: str, below: str) -> str:
    frame = f'<rect width="{width:.1f}" height="{height:.1f}" fill="none" stroke="currentColor" stroke-opacity=".5"/>'
    text = f'<text x="0" y="{height + 14:.0f}" font-size="11" fill="currentColor">{_text(below)}</text>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width + 2:.0f}" height="{height + 20:.0f}" role="img" '
        f'viewBox="-1 -1 {width + 2:.1f} {height + 20:.1f}"><title>{_text(says)}</title>{inside}{frame}{text}</svg>'
    )
