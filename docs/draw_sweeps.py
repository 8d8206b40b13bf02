"""The picture of good and bad sweeps in docs/scanning.md, each with what sonocal says of it.

python -m docs.draw_sweeps
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import sonocal as sc
from sonocal.geometry import Array

PICTURE = Path(__file__).parent / "pictures" / "sweeps.png"
SIZE_PX, MM_PER_PX, COUNT = 500, 0.24, 40
SIGMA_PX, SIGMA_MM = 1.0, 0.5
GOOD, BAD, FAINT = "#1b7f4b", "#b3261e", "#c9ced6"
# Of a needle, to either side of the image: as it is tracked, and as it is drawn.
REACH_MM, DRAWN_MM = 200.0, 45.0

# Where the needle crosses the image (N, 2), px, and where it points (N, 3), in the image's axes.
Held = Callable[[np.random.Generator], tuple[Array, Array]]


@dataclass(frozen=True)
class Sweep:
    """One way to hold a needle.

    Attributes:
        title: what was done.
        held: makes the poses.
        code: of what sonocal says, "" for nothing.
    """

    title: str
    held: Held
    code: str


def anywhere(
    rng: np.random.Generator, low: tuple[float, float] = (40, 40), high: tuple[float, float] = (460, 460)
) -> Array:
    return rng.uniform(low, high, (COUNT, 2))


def tilted(rng: np.random.Generator, least_deg: float = 15, most_deg: float = 50) -> Array:
    """At such angles from the image's normal, to all sides."""
    tilt, side = np.radians(rng.uniform(least_deg, most_deg, COUNT)), rng.uniform(0, 2 * np.pi, COUNT)
    return np.stack([np.sin(tilt) * np.cos(side), np.sin(tilt) * np.sin(side), np.cos(tilt)], axis=-1)


def parallel(rng: np.random.Generator) -> tuple[Array, Array]:
    return anywhere(rng), np.tile([0.35, 0.45, 0.82], (COUNT, 1))


def through_a_port(rng: np.random.Generator) -> tuple[Array, Array]:
    points = anywhere(rng)
    port_mm = np.array([60.0, 30.0, 35.0])
    return points, np.column_stack([points * MM_PER_PX, np.zeros(COUNT)]) - port_mm


def on_the_bottom(rng: np.random.Generator) -> tuple[Array, Array]:
    turn = rng.uniform(-0.9, 0.9, COUNT)
    points = np.column_stack([rng.uniform(40, 460, COUNT), np.full(COUNT, 400.0)])
    return points, np.stack([np.sin(turn), np.zeros(COUNT), np.cos(turn)], axis=-1)


SWEEPS = (
    Sweep("Good: all over, tilted to all sides", lambda rng: (anywhere(rng), tilted(rng)), ""),
    Sweep("Parallel needles", parallel, "parallel-lines"),
    Sweep("Hardly tilted", lambda rng: (anywhere(rng), tilted(rng, 0, 8)), "weak-motion"),
    Sweep("Through one port", through_a_port, "lines-through-one-point"),
    Sweep("Along the tank's bottom", on_the_bottom, "coplanar-lines"),
    Sweep(
        "In a band of the image",
        lambda rng: (anywhere(rng, (40, 300), (460, 330)), tilted(rng)),
        "narrow-area",
    ),
    Sweep(
        "In a corner of the image",
        lambda rng: (anywhere(rng, (330, 40), (460, 160)), tilted(rng)),
        "weak-motion",
    ),
    Sweep("In the image's plane", lambda rng: (anywhere(rng), tilted(rng, 86, 90)), "needle-in-image-plane"),
)


def main() -> None:
    """Write the picture."""
    import matplotlib.pyplot as plt

    from sonocal.report.style import RC

    with plt.rc_context({**RC, "font.size": 8.5}):
        figure = plt.figure(figsize=(6.7, 9.4), dpi=150)
        boxes = figure.subfigures(4, 2, wspace=0.02, hspace=0.02)
        for box, sweep in zip(boxes.flat, SWEEPS, strict=True):
            draw(box, sweep)
        figure.savefig(PICTURE, metadata={"Software": None})
    plt.close(figure)


def table(sweep: Sweep) -> sc.Observations:
    """The sightings, with noise; the marker's frame is the image's, in mm, 80 mm above its middle."""
    rng = np.random.default_rng(7)
    points, along = sweep.held(rng)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    centre = np.column_stack([points * MM_PER_PX, np.zeros(COUNT)]) + np.array([-60.0, 80.0, 0.0])
    ends = np.stack([centre - REACH_MM * along, centre + REACH_MM * along], axis=1)
    return sc.Observations(
        points + rng.normal(scale=SIGMA_PX, size=points.shape),
        ends + rng.normal(scale=SIGMA_MM, size=ends.shape),
        image_size_px=(SIZE_PX, SIZE_PX),
        source=sweep.title,
    )


def said_of(sweep: Sweep) -> tuple[str, float | None]:
    """The code of what sonocal says first, and the worst predicted error (95 %) at a corner, mm; None where refused."""
    try:
        found = sc.calibrate(table(sweep))
    except sc.DegenerateGeometryError as refusal:
        return refusal.code, None
    first = found.warnings[0].code if found.warnings else ""
    return first, float(found.predicted_errors()[2].max())


def draw(box, sweep: Sweep) -> None:  # noqa: ANN001
    """Left what the scanner shows, right the needles from the side."""
    points, along = sweep.held(np.random.default_rng(7))
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    colour = BAD if sweep.code else GOOD
    image, side = box.subplots(1, 2, gridspec_kw={"left": 0.04, "right": 0.97, "top": 0.86, "bottom": 0.22})
    box.suptitle(sweep.title, x=0.04, ha="left", y=0.97, weight="bold", fontsize=9.5, color=colour)
    centre = np.column_stack([points * MM_PER_PX, np.zeros(COUNT)])
    for axis, (first, second), name in ((image, (0, 1), "the image"), (side, (2, 1), "from the side")):
        for middle, direction in zip(centre, along, strict=True):
            ends = middle + np.outer([-DRAWN_MM, DRAWN_MM], direction)
            axis.plot(
                ends[:, first], ends[:, second], color=FAINT if axis is image else colour, linewidth=0.6
            )
        axis.set(
            xlim=(-5, 125) if axis is image else (-65, 65),
            ylim=(125, -5),
            aspect="equal",
            xticks=[],
            yticks=[],
        )
        axis.set_xlabel(name)
    image.plot(*(points * MM_PER_PX).T, ".", color=colour, markersize=4)
    side.plot([0, 0], [0, SIZE_PX * MM_PER_PX], color="#20242b", linewidth=2)
    box.text(0.04, 0.05, sentence(sweep), fontsize=8.5, color="#20242b")


def sentence(sweep: Sweep) -> str:
    code, worst = said_of(sweep)
    if worst is None:
        return f"refused: {code}"
    return f"corners within {worst:.1f} mm" + (f": {code}" if code else "")


if __name__ == "__main__":
    main()
