"""The page beside a volume: what it looks like, where it lies, what it was made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sonocal.errors import UnsupportedError, require
from sonocal.reconstruction.files import Axes
from sonocal.reconstruction.previews import Picture, preview
from sonocal.reconstruction.volume import Volume

if TYPE_CHECKING:
    import matplotlib.axes

__all__ = ["plot_picture", "volume_html"]

MOST_PX = 600
WIDTH_IN, LEAST_IN, MOST_IN, MARGIN_IN = 4.6, 1.6, 7.0, 0.8
ROUND = (1.0, 2.0, 5.0, 10.0)
PATIENT = {
    "lps": "x is read as left, y as posterior, z as superior (LPS), as PLUS's files are",
    "ras": "x is read as right, y as anterior, z as superior (RAS), as 3D Slicer shows what a tracker streams",
}


def volume_html(
    volume: Volume, *, axes: Axes = "lps", name: str = "volume", made_of: Sequence[tuple[str, str]] = ()
) -> bytes:
    """The page as the content of an HTML file that needs no network.

    Args:
        volume: what is shown.
        axes: how other programs are to read x, y, z: "lps" or "ras".
        name: what the volume is called, such as its file.
        made_of: names and values of what it was made of, to stand at the end.

    Raises:
        UnsupportedError: matplotlib or jinja2 is not installed.
    """
    pictures = preview(volume, axes)
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise UnsupportedError(
            f"the report needs {error.name}, which is not installed; pip install matplotlib jinja2, or --no-report"
        ) from None
    from sonocal.report.style import RC
    from sonocal.report.templates import filled, now

    brightest = max(float(picture.image.max()) for picture in pictures)
    with mpl.rc_context(RC):
        drawn = [(_title(one), _svg(k, one, brightest)) for k, one in enumerate(pictures)]
    return filled(
        "volume.html",
        name=name,
        made=now(),
        source=volume.source,
        images=volume.images,
        left_out=volume.left_out,
        filled_share=volume.filled_share,
        patient=PATIENT[axes],
        pictures=drawn,
        facts=_facts(volume),
        provenance=made_of,
    )


def plot_picture(axis: matplotlib.axes.Axes, picture: Picture, brightest: float = 255.0) -> None:
    """A picture in mm, with a scale bar and what lies on its sides.

    Args:
        axis: to draw on.
        picture: of `preview`.
        brightest: the grey level that is white.
    """
    require("picture", picture, Picture)
    from matplotlib.patheffects import withStroke

    image, (left, right, bottom, top) = picture.image, picture.edges_mm
    step = max(1, -(-max(image.shape) // MOST_PX))
    # Unsmoothed: as many pixels as there are voxels, and no more bytes than these.
    axis.imshow(
        image[::step, ::step],
        cmap="gray",
        vmin=0,
        vmax=brightest,
        extent=(left, right, bottom, top),
        interpolation="none",
    )
    axis.set(xlabel=f"{picture.across}, mm", ylabel=f"{picture.upright}, mm")
    said: Any = {"color": "white", "transform": axis.transAxes}
    letter_rim, bar_rim = ([withStroke(linewidth=wide, foreground="black")] for wide in (2.5, 4.5))
    places = [(0.02, 0.5), (0.98, 0.5), (0.5, 0.02), (0.5, 0.98)]
    sides = [("left", "center"), ("right", "center"), ("center", "bottom"), ("center", "top")]
    for letter, (x, y), (across, upright) in zip(picture.letters, places, sides, strict=True):
        axis.text(x, y, letter, ha=across, va=upright, weight="bold", path_effects=letter_rim, **said)
    width = abs(right - left)
    length = _round_below(width / 4)
    axis.plot(
        [0.04, 0.04 + length / width],
        [0.05, 0.05],
        linewidth=2.5,
        solid_capstyle="butt",
        path_effects=bar_rim,
        **said,
    )
    axis.text(0.04, 0.07, f"{length:g} mm", va="bottom", path_effects=letter_rim, **said)


def _round_below(length_mm: float) -> float:
    """The greatest of 1, 2, 5 and ten's powers of these that is no longer."""
    power = 10.0 ** np.floor(np.log10(length_mm))
    return float(max(one * power for one in ROUND if one * power <= length_mm * (1 + 1e-9)))


def _title(picture: Picture) -> str:
    if picture.at_mm is None:
        return f"the brightest along {picture.along}"
    return f"cut at {picture.along} = {picture.at_mm:.1f} mm"


def _svg(number: int, picture: Picture, brightest: float) -> str:
    from sonocal.report.svg import figure_svg

    left, right, bottom, top = picture.edges_mm
    drawn = (WIDTH_IN - MARGIN_IN) * abs(top - bottom) / abs(right - left)
    height = float(np.clip(drawn, LEAST_IN, MOST_IN)) + MARGIN_IN
    return figure_svg(
        f"picture{number}", (WIDTH_IN, height), lambda axis: plot_picture(axis, picture, max(1.0, brightest))
    )


def _facts(volume: Volume) -> list[tuple[str, str]]:
    """What it is, in numbers."""
    grid = volume.grid
    last = grid.origin_mm + grid.spacing_mm * (np.array(grid.size) - 1)
    facts = [
        ("frame", volume.reference),
        ("voxels along x, y, z", " x ".join(map(str, grid.size))),
        ("their size", " x ".join(f"{s:g}" for s in grid.spacing_mm) + " mm"),
        ("from", ", ".join(f"{x:.1f}" for x in grid.origin_mm) + " mm (centre of the first voxel)"),
        ("to", ", ".join(f"{x:.1f}" for x in last) + " mm (centre of the last)"),
        ("filled", f"{100 * volume.filled_share:.0f} % of the voxels"),
    ]
    if volume.error_um is not None and volume.filled:
        off = np.concatenate([layer[layer > 0] for layer in volume.error_um[:: max(1, grid.size[2] // 64)]])
        if len(off):
            facts.append(("a voxel is within", f"{np.median(off) / 1000:.2f} mm (95 %, median)"))
    return facts
