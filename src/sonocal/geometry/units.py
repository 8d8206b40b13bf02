"""Are lengths in mm and places in px? What no scanner shows and no needle measures is doubted, by the unit's name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.geometry.transforms import Array

__all__ = [
    "GO_ON",
    "UNITS",
    "UNITS_CODE",
    "Hint",
    "length_hints",
    "needle_hints",
    "place_hints",
    "scale_hints",
    "scan_hints",
    "tip_hints",
    "unit_doubt",
]

UNITS_CODE = "implausible-units"
GO_ON = "; if they are what they say, go on with --accept-units"
"""With which advice ends, where there is something to go on with."""
# What mm a unit is, in the order of how often people have it.
UNITS = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4, "micrometres": 0.001, "millimetres": 1.0}
# No scanner shows less or more: 0.02 mm/px is a probe of 20 MHz, 1.5 a large abdomen in a thumbnail.
LEAST_SCALE, MOST_SCALE = 0.01, 1.5
# Of volumes, whose voxels are coarser: of the deepest settings that scanners have, 240 mm, 64 voxels show 3.75 mm each,
# and coarser grids show no needle. What is meant otherwise is far beyond: shares of the volume come to some 100 mm.
MOST_VOLUME_SCALE = 4.0
# Of the scale's logarithm: it counts as out of bounds when its uncertainty does not bring it back.
SURE = 2.0
# Of a logarithm: what is as unsure as this is in no bounds, and twice as much is no number any more.
MOST_SLACK = 300.0
# Scanners mostly show between these: a unit that brings a scale here is named.
USUAL_SCALE = (0.03, 0.8)
# Two points that span a line may be a unit apart, and may span a room.
LEAST_SPAN_MM, MOST_SPAN_MM = 0.9, 5000.0
# Needles are 30 to 400 mm long, threads and wires up to a few metres.
LEAST_NEEDLE_MM, MOST_NEEDLE_MM = 5.0, 3000.0
USUAL_NEEDLE_MM = (30.0, 1000.0)
# Markers are centimetres wide: nothing tracked turns and moves with its origin so near another's, or in a larger room.
LEAST_PLACE_MM, MOST_PLACE_MM = 10.0, 50_000.0
# Of a rotation matrix's entries: a tool that is used, and not a constant between two markers.
TURNED = 0.1
# A room, for units that bring a place here: from beside the tracker to its far end.
USUAL_PLACE_MM = (30.0, 10_000.0)
# Of a scan in centimetres each of these is smaller; of a scan in mm one may be, but not all three.
SMALL_IMAGE_MM, SMALL_NEEDLE_MM, NEAR_MARKER_MM = 25.0, 30.0, 25.0
# Needles may be long, so that one in centimetres is as long as others in mm. Without it the rest must say more: an area
# of that size, of pixels and voxels as fine as only probes of 20 MHz have them, and trackers better than any is.
TINY_IMAGE_MM, TINY_SCALE, TINY_VOXEL, TINY_RMS_MM = 20.0, 0.045, 0.1, 0.2
# What images usually show, and the most across that any does.
USUAL_IMAGE_MM, MOST_IMAGE_MM = (40.0, 260.0), 400.0
# A tip so near the marker is no rarity of sensors in needles, but no tracker tells a tip's rest from place to place to
# so little.
NEAR_TIP_MM, TINY_PIVOT_MM, USUAL_TIP_MM = 30.0, 0.08, (50.0, 400.0)
# Scales this near 1 mm/px are of places that are in mm already; of volumes' voxels it is a usual size.
NEAR_ONE = 0.02
# Places of images are counted in px from 0; normalised ones end at 1, and a detector may find a little more.
MOST_NORMALISED = 1.05
# Images that show anything are wider than this.
LEAST_IMAGE_PX = 16.0
# Which unit could be meant is said where it brings one of the numbers into its usual range.
Range = tuple[float, float]


@dataclass(frozen=True)
class Hint:
    """A number that no set-up has.

    Attributes:
        what: it, in words, with its bounds.
        value: the number; or None where it is not the lengths that are doubted.
        usual: what such numbers mostly are.
        question: what they may be instead, where it is not a unit of length.
        remedy: for that.
    """

    what: str
    value: float | None = None
    usual: Range = (0.0, np.inf)
    question: str = ""
    remedy: str = ""

    def units(self, read_as: str) -> list[str]:
        """The units that would make it a usual number, beside the one that it was read as."""
        if self.value is None:
            return []
        number, others = self.value / UNITS[read_as], {n: mm for n, mm in UNITS.items() if n != read_as}
        return [name for name, mm in others.items() if self.usual[0] <= mm * number <= self.usual[1]]


def unit_doubt(hints: Sequence[Hint], where: str = "", read_as: str = "millimetres") -> Iterator[Diagnostic]:
    """The finding of hints, if there are any: which unit the numbers might be in, and what to multiply by.

    Args:
        hints: numbers that no set-up has.
        where: what holds them, if that is not plain, such as "needle.toml: ".
        read_as: the unit that the file's lengths were read as, before they came to mm.
    """
    if not hints:
        return
    named = [hint.units(read_as) for hint in hints if hint.value is not None]
    common = [name for name in UNITS if named and all(name in names for names in named)]
    units = common or list(dict.fromkeys(name for names in named for name in names))
    other = next((hint for hint in hints if hint.question), None)
    question = other.question if other else "are these " + (" or ".join(units) if units else "millimetres")
    what = "; ".join(hint.what for hint in hints)
    if read_as != "millimetres":
        what += f", read as {read_as}"
    yield Diagnostic(
        code="implausible-units",
        severity="warning",
        message=f"{where}{question}? {what}",
        advice=(other.remedy if other else _remedy(units, read_as)) + GO_ON,
    )


def _remedy(units: Sequence[str], read_as: str) -> str:
    if not units:
        return "give lengths in mm and places of the image in px"
    factors = {unit: f"{UNITS[unit] / UNITS[read_as]:g}" for unit in units}
    by = " or ".join(f"{factor} ({unit})" if len(units) > 1 else factor for unit, factor in factors.items())
    return f"multiply lengths by {by}"


def scale_hints(scales: Array, deviation: float = 0.0, dimension: int = 2) -> list[Hint]:
    """Of mm per px.

    Args:
        scales: (1,) to (3,).
        deviation: standard deviation of their logarithm.
        dimension: of the image: 2, or 3 for a volume.
    """
    slack = np.exp(min(SURE * deviation, MOST_SLACK)) if np.isfinite(deviation) else 1.0
    least, most = float(np.min(scales)), float(np.max(scales))
    if least * slack < LEAST_SCALE:
        said = f"the scale came out as {least:.2g} mm/px, and no scanner shows less than {LEAST_SCALE:g}"
        return [Hint(said, least, USUAL_SCALE)]
    bound = MOST_SCALE if dimension == 2 else MOST_VOLUME_SCALE
    if most / slack > bound:
        said = f"the scale came out as {most:.3g} mm/px, and no scanner shows more than {bound:g}"
        return [Hint(said, most, USUAL_SCALE)]
    if dimension == 2 and max(deviation, float(np.abs(np.log(scales)).max())) < NEAR_ONE:
        return [
            Hint(
                f"the scale came out as {np.mean(scales):.3f} mm/px",
                question="are the image's points in mm already",
                remedy="give places in the image in px",
            )
        ]
    return []


def length_hints(points_px: Array, lengths_mm: Array) -> list[Hint]:
    """Of a table's numbers as they stand: places (N, d) in the image, lengths (M,) of what spans lines and planes."""
    if not len(points_px):
        return []
    hints = []
    if np.abs(points_px).max() <= MOST_NORMALISED:
        hints.append(
            Hint(
                "all places of the image are between -1 and 1, as normalised ones are",
                question="are these pixels",
                remedy="multiply u by the image's width in px and v by its height",
            )
        )
    elif (share := _share_of_one(points_px)) is not None:
        hints.append(share)
    if not len(lengths_mm):
        return hints
    length = float(np.median(lengths_mm))
    if not LEAST_SPAN_MM <= length <= MOST_SPAN_MM:
        hints.append(Hint(f"segments are {length:.2g} mm long in the middle", length, USUAL_NEEDLE_MM))
    return hints


def _share_of_one(points_px: Array) -> Hint | None:
    """Of places (N, d) of which one axis is counted in shares and another in px."""
    most = np.abs(points_px).max(axis=0)
    odd = most <= MOST_NORMALISED
    if not np.any(odd & (most > 0)) or most.max() < LEAST_IMAGE_PX:
        return None
    axis = int(np.argmax(odd & (most > 0)))
    name, side = "uvw"[axis], ("width", "height", "depth")[axis]
    return Hint(
        f"all of {name} is between -1 and 1, as shares of the image are, and {'uvw'[int(np.argmax(most))]} reaches "
        f"{most.max():.0f}",
        question=f"is {name} in pixels",
        remedy=f"multiply {name} by the image's {side} in px",
    )


def scan_hints(
    *, image_mm: float, needle_mm: float, marker_mm: float, scale: float, rms_mm: float, dimension: int
) -> list[Hint]:
    """Of a scan whose scale may be: all of it too small, as in centimetres, or an image too large.

    Args:
        image_mm: the longest side of the area seen.
        needle_mm: the usual segment's length.
        marker_mm: of the marker from the middle of the area seen.
        scale: mm per px.
        rms_mm: of the residuals.
        dimension: of the image.
    """
    if image_mm > MOST_IMAGE_MM:
        said = f"the area seen is {image_mm:.3g} mm long, and no scanner shows more than {MOST_IMAGE_MM:g}"
        return [Hint(said, image_mm, USUAL_IMAGE_MM)]
    if image_mm >= SMALL_IMAGE_MM or marker_mm >= NEAR_MARKER_MM:
        return []
    seen = f"the area seen {image_mm:.2g} mm, and the marker lies {marker_mm:.2g} mm from its middle"
    if LEAST_SPAN_MM < needle_mm < SMALL_NEEDLE_MM:
        said = f"the needle's segments are {needle_mm:.2g} mm long, {seen}"
        return [Hint(said, needle_mm, USUAL_NEEDLE_MM)]
    fine = scale < (TINY_SCALE if dimension == 2 else TINY_VOXEL)
    if image_mm < TINY_IMAGE_MM and fine and rms_mm < TINY_RMS_MM:
        said = f"the scale came out as {scale:.2g} mm/px, residuals as {rms_mm:.2g} mm rms, {seen}"
        return [Hint(said, image_mm, USUAL_IMAGE_MM)]
    return []


def needle_hints(name: str, length_mm: float) -> list[Hint]:
    """Of a needle or wire that a file of targets describes."""
    if LEAST_NEEDLE_MM <= length_mm <= MOST_NEEDLE_MM:
        return []
    return [Hint(f"{name} is {length_mm:.2g} mm long", length_mm, USUAL_NEEDLE_MM)]


def tip_hints(tip_mm: float, rms_mm: float) -> list[Hint]:
    """Of a pivot: the tip's distance from the marker's origin, and what is left of its rest."""
    if tip_mm >= NEAR_TIP_MM or rms_mm >= TINY_PIVOT_MM:
        return []
    said = (
        f"the tip lies {tip_mm:.2g} mm from the marker's origin and rests to {rms_mm:.1g} mm rms, "
        "which no tracker can tell"
    )
    return [Hint(said, tip_mm, USUAL_TIP_MM)]


@np.errstate(over="ignore")
def place_hints(name: str, matrices: Array) -> list[Hint]:
    """Of a tool's valid poses (N, 4, 4): one that turns and moves, but in no room of a usual size."""
    if len(matrices) < 2:
        return []
    places = matrices[:, :3, 3]
    away = float(np.linalg.norm(places, axis=1).max())
    turned = np.abs(matrices[:, :3, :3] - matrices[0, :3, :3]).max() > TURNED
    moved = np.ptp(places, axis=0).max() > 0
    if away > MOST_PLACE_MM or (away < LEAST_PLACE_MM and turned and moved):
        return [Hint(f"{name} is at most {away:.2g} mm from its origin", away, USUAL_PLACE_MM)]
    return []
