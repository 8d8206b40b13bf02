"""The drawing of docs/bucket.md: a probe that is tilted over a thread in a bucket, and what its images show.

python -m docs.draw_bucket
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

PICTURE = Path(__file__).parent / "pictures" / "bucket.svg"
WATER, EDGE, PROBE, THREAD, FAN, WORDS = "#d9ecf7", "#5b6b7a", "#37474f", "#b3261e", "#b9c6d0", "#222222"
# How deep the thread is where it is seen.
SEEN = 250.0
# Tilt of the probe, deg; where the thread lies in its image, as shares of its width and depth; what is written below.
STEPS = (
    (-35.0, (0.25, 0.55), "tilted to one side"),
    (0.0, (0.5, 0.8), "upright, turned about itself"),
    (35.0, (0.72, 0.6), "tilted to the other"),
)
WIDTH, DEPTH, PANEL = 84.0, 138.0, 300.0


MARKER = ((-22, -74), (0, -84), (22, -74))


def drawn(kind: str, **attributes: object) -> str:
    """An element without content."""
    return (
        f"<{kind} "
        + " ".join(f'{name.replace("_", "-")}="{value}"' for name, value in attributes.items())
        + "/>"
    )


def polygon(*corners: tuple[float, float], **attributes: object) -> str:
    """A closed shape."""
    return drawn("polygon", points=" ".join(f"{x:.0f},{y:.0f}" for x, y in corners), **attributes)


def bucket(middle: float) -> Iterator[str]:
    """Water and the thread in it."""
    rim = [(middle - 125, 120), (middle - 105, 310), (middle + 105, 310), (middle + 125, 120)]
    yield polygon(*rim, fill=WATER, stroke=EDGE, stroke_width=2)
    ends = {"x1": middle - 113, "y1": SEEN - 18, "x2": middle + 113, "y2": SEEN + 18}
    yield drawn("line", **ends, stroke=THREAD, stroke_width=1.5, stroke_dasharray="5 3")


def probe() -> Iterator[str]:
    """A probe that looks down from the origin, with its image and its marker."""
    half = WIDTH / 2
    image = [(-half / 2, 0), (-half, DEPTH), (half, DEPTH), (half / 2, 0)]
    yield polygon(*image, fill=FAN, fill_opacity=0.55, stroke=EDGE)
    yield polygon((-24, 0), (-20, -14), (-9, -62), (9, -62), (20, -14), (24, 0), fill=PROBE)
    for x, y in MARKER:
        yield drawn("circle", cx=x, cy=y, r=6, fill="#ffffff", stroke=PROBE, stroke_width=2)


def panel(left: float, tilt_deg: float, seen: tuple[float, float], words: str) -> Iterator[str]:
    """A bucket with the thread, and a probe that is held so that its image shows it at a place."""
    middle = left + PANEL / 2
    yield from bucket(middle)
    right, down = (seen[0] - 0.5) * WIDTH, seen[1] * DEPTH
    there = f"translate({middle:.0f} {SEEN:.0f}) rotate({tilt_deg:g}) translate({-right:.1f} {-down:.1f})"
    yield f'<g transform="{there}">'
    yield from probe()
    yield "</g>"
    yield drawn("circle", cx=middle, cy=SEEN, r=6, fill=THREAD)
    yield f'<text x="{middle:.0f}" y="340" text-anchor="middle">{words}</text>'


def picture() -> str:
    """The drawing."""
    head = f'viewBox="0 0 {3 * PANEL:.0f} 360" font-family="sans-serif" font-size="15" fill="{WORDS}"'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {head}>',
        "<title>A probe tilted to one side, upright and tilted to the other over a thread in a bucket</title>",
    ]
    for i, (tilt, seen, words) in enumerate(STEPS):
        lines += panel(i * PANEL, tilt, seen, words)
    lines += [
        f'<text x="505" y="252" fill="{THREAD}" font-size="13">thread</text>',
        f'<text x="{1.5 * PANEL + 34:.0f}" y="72" font-size="13">marker</text>',
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the drawing."""
    PICTURE.write_text(picture(), encoding="utf-8")


if __name__ == "__main__":
    main()
