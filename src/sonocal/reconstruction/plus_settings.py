"""What a PLUS device set says of volumes: its element VolumeReconstruction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from sonocal.errors import InputError, UnsupportedError
from sonocal.files import path_of
from sonocal.files.xml import parse_xml, read_xml
from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = ["PlusSettings", "Sticks", "read_plus_settings"]

Pair = tuple[float, float]
INTERPOLATIONS = {"NEAREST_NEIGHBOR": False, "LINEAR": True}
COMPOUNDINGS = ("MEAN", "IMPORTANCE_MASK", "MAXIMUM", "LATEST")
OPTIMIZATIONS = ("NONE", "PARTIAL", "FULL")
DEFAULT_STOP_PX = 500.0
MOST_STICK = 1 << 14
OLD_VERSIONS = ("1.0", "2.0")


@dataclass(frozen=True)
class Sticks:
    """One way that PLUS fills holes: along sticks.

    Attributes:
        limit: voxels of a stick, its ends included.
        most: sticks that are averaged, at least.
    """

    limit: int
    most: int

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class PlusSettings:
    """How PLUS would make a volume, in its own words.

    Attributes:
        name: of the device set.
        reference: the volume's frame.
        spacing_mm: (3,).
        origin_mm: (3,), where it is given with `extent`.
        extent: voxels 0 <= i < n along x, y and z; None: around all images.
        linear: whether a pixel goes to the eight voxels around it, or to the nearest.
        compounding: MEAN, IMPORTANCE_MASK, MAXIMUM or LATEST.
        optimization: NONE, PARTIAL or FULL: of PLUS's three codes, which differ in their last bits.
        clip_origin_px, clip_size_px: the clip rectangle; a size of 0 is the whole image.
        fan_angles_deg: of the fan's edges; both 0: no fan.
        fan_origin_px: the fan's apex.
        fan_radii_px: where it starts and stops.
        rejection: pixels darker than this are left out.
        every: images that one is taken of.
        importance: the file of the importance mask.
        sticks: how holes are filled, one way after the other.
        truncates: that a volume around all images ends with the last whole voxel, as before PLUS 2.1, and not with the
            nearest.
    """

    name: str
    reference: str
    spacing_mm: Array
    origin_mm: Array | None
    extent: tuple[int, int, int] | None
    linear: bool
    compounding: str
    optimization: str
    clip_origin_px: Pair
    clip_size_px: Pair
    fan_angles_deg: Pair
    fan_origin_px: Pair
    fan_radii_px: Pair
    rejection: float
    every: int
    importance: Path | None
    sticks: tuple[Sticks, ...]
    truncates: bool

    __repr__ = brief


def read_plus_settings(path: str | Path) -> PlusSettings:
    """Read how a PLUS device set has volumes made.

    Raises:
        FormatError: the file is no XML.
        InputError: it has no element VolumeReconstruction, or an attribute of it cannot be used.
        UnsupportedError: it asks for what sonocal does not do as PLUS does.
    """
    path = path_of(path)
    root = parse_xml(path.name, read_xml(path))
    element = root.find("VolumeReconstruction")
    if element is None:
        raise InputError(
            f"{path.name}: has no element VolumeReconstruction, which says how PLUS makes a volume"
        )
    said = _Said(path.name, element)
    said.refuse_the_rest()
    origin, extent = said.box()
    importance = element.get("ImportanceMaskFilename")
    return PlusSettings(
        name=path.name,
        reference=element.get("ReferenceCoordinateFrame") or "Reference",
        spacing_mm=said.spacing(),
        origin_mm=origin,
        extent=extent,
        linear=INTERPOLATIONS[said.word("Interpolation", tuple(INTERPOLATIONS), "NEAREST_NEIGHBOR")],
        compounding=said.word("CompoundingMode", COMPOUNDINGS, _older(element)),
        optimization=said.word("Optimization", OPTIMIZATIONS, "FULL"),
        clip_origin_px=said.pair("ClipRectangleOrigin"),
        clip_size_px=said.pair("ClipRectangleSize"),
        fan_angles_deg=said.pair("FanAnglesDeg", said.pair("FanAngles")),
        fan_origin_px=said.pair("FanOriginPixel", said.pair("FanOrigin")),
        fan_radii_px=(
            said.number("FanRadiusStartPixel", 0.0),
            said.number("FanRadiusStopPixel", said.depth()),
        ),
        rejection=said.number("PixelRejectionThreshold", -np.inf),
        every=max(1, int(said.number("SkipInterval", 1))),
        importance=None if not importance else path.parent / importance,
        sticks=tuple(said.sticks()) if element.get("FillHoles", "OFF").upper() == "ON" else (),
        truncates=root.get("version", "").strip() in OLD_VERSIONS,
    )


def _older(element: ET.Element) -> str:
    """The compounding of a device set that says it as PLUS did before 2.2."""
    if element.get("Calculation") == "MAXIMUM":
        return "MAXIMUM"
    return "LATEST" if element.get("Compounding", "ON") == "OFF" else "MEAN"


@dataclass(frozen=True)
class _Said:
    """The attributes of the element."""

    name: str
    element: ET.Element

    def numbers(self, key: str, count: int) -> Array | None:
        text = self.element.get(key)
        if text is None:
            return None
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.array([])
        if values.shape != (count,) or not np.isfinite(values).all():
            raise InputError(
                f"{self.name}: {key} of VolumeReconstruction is {count} finite numbers; got {text[:60]!r}"
            )
        return values

    def number(self, key: str, default: float) -> float:
        values = self.numbers(key, 1)
        return default if values is None else float(values[0])

    def pair(self, key: str, default: Pair = (0.0, 0.0)) -> Pair:
        values = self.numbers(key, 2)
        return default if values is None else (float(values[0]), float(values[1]))

    def depth(self) -> float:
        return self.number("FanDepth", DEFAULT_STOP_PX)

    def word(self, key: str, known: tuple[str, ...], default: str) -> str:
        value = (self.element.get(key) or default).upper()
        if value not in known:
            raise UnsupportedError(
                f"{self.name}: {key} of VolumeReconstruction is {value[:40]}, and volumes as PLUS makes them are made "
                f"with {', '.join(known)}"
            )
        return value

    def spacing(self) -> Array:
        spacing = self.numbers("OutputSpacing", 3)
        if spacing is None or not (spacing > 0).all():
            raise InputError(f"{self.name}: VolumeReconstruction needs OutputSpacing, three lengths in mm")
        return spacing

    def box(self) -> tuple[Array | None, tuple[int, int, int] | None]:
        origin, extent = self.numbers("OutputOrigin", 3), self.numbers("OutputExtent", 6)
        if origin is None or extent is None:
            return None, None
        x, y, z = (int(n) for n in extent[1::2] - extent[::2] + 1)
        if extent[::2].any() or min(x, y, z) < 1:
            raise UnsupportedError(
                f"{self.name}: OutputExtent of VolumeReconstruction starts at 0 along each axis"
            )
        return origin, (x, y, z)

    def sticks(self) -> Iterator[Sticks]:
        for filler in self.element.iterfind("HoleFilling/HoleFillingElement"):
            if (kind := (filler.get("Type") or "").upper()) != "STICK":
                raise UnsupportedError(
                    f"{self.name}: holes are filled with STICK as PLUS does, and not with {kind[:40] or 'nothing'}"
                )
            of_filler = _Said(self.name, filler)
            limit, most = (
                int(of_filler.number(key, 1)) for key in ("StickLengthLimit", "NumberOfSticksToUse")
            )
            if not (0 <= limit <= MOST_STICK and 0 <= most <= MOST_STICK):
                raise InputError(f"{self.name}: sticks of HoleFilling are between 0 and {MOST_STICK}")
            yield Sticks(limit, most)

    def refuse_the_rest(self) -> None:
        if (self.element.get("EnableFanAnglesAutoDetect") or "FALSE").upper() == "TRUE":
            raise UnsupportedError(
                f"{self.name}: EnableFanAnglesAutoDetect narrows PLUS's fan in each image, which sonocal does not; "
                "give FanAnglesDeg alone"
            )
