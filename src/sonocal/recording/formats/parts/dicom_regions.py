"""mm per px of a DICOM image: each ultrasound region has its own, in units of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonocal.errors import FormatError
from sonocal.findings import Diagnostic
from sonocal.recording.formats.parts.dicom_file import DicomFile, Item

__all__ = ["scale_of", "shared_scale"]

Spacing = tuple[float, float]
Scale = tuple[Spacing | None, tuple[Diagnostic, ...]]

MM_PER_CM = 10.0
CENTIMETRES = 3
TWO_D, GRAPHICS = 1, 5
TISSUE = 1
# DICOM PS3.3, C.8.5.5.1: what a region shows, and the units along its axes.
FORMATS = {1: "2D", 2: "M-mode", 3: "spectrum", 4: "waveform", 5: "graphics"}
TYPES = {1: "tissue", 2: "colour flow", 3: "Doppler", 4: "Doppler", 9: "Doppler", 10: "ECG"}
UNITS = ("none", "percent", "dB", "cm", "s", "Hz", "dB/s", "cm/s", "cm2", "cm2/s", "cm3", "cm3/s", "degrees")
# Scales of two regions that differ by less are one, rounded twice.
SAME = 1e-3


def scale_of(file: DicomFile) -> Scale:
    """(u, v) mm/px of the image, and what is to be said of it.

    It is that of the regions of 2D tissue where they agree; PixelSpacing, which is (row, column), where there are no
    regions in cm. Regions of 2D tissue that differ leave it unknown.
    """
    shown = [one for one in _regions(file) if one.format != GRAPHICS]
    tissue = [one for one in shown if one.format == TWO_D and one.type == TISSUE] or shown
    scales = [one.spacing for one in tissue if one.spacing is not None]
    if not scales:
        return _pixel_spacing(file), _unscaled(tissue)
    if not all(_alike(one, scales[0]) for one in scales):
        return None, (_differing(tissue),)
    others = [one for one in shown if one.spacing is None or not _alike(one.spacing, scales[0])]
    return scales[0], (_of_tissue_alone(tissue, others),) if others else ()


def shared_scale(scales: Sequence[Scale]) -> Scale:
    """The mm/px that several files agree upon, and what is said of the first: a scanner's depth may be changed."""
    first, said = scales[0]
    found = [spacing for spacing, _ in scales]
    odd = next(
        (i for i, one in enumerate(found) if (one is None) != (first is None) or not _alike(one, first)), None
    )
    if odd is None:
        return first, said
    shown = [
        "no mm/px" if one is None else "{:.4g} x {:.4g} mm/px".format(*one) for one in (first, found[odd])
    ]
    changed = Diagnostic(
        code="region-scales",
        severity="warning",
        message=f"images have different mm/px: {shown[0]} at first, {shown[1]} in image {odd}",
        advice="keep images of one depth and zoom in the folder: a calibration holds for one",
    )
    return None, (changed, *said)


def _alike(one: Spacing | None, other: Spacing | None) -> bool:
    return one is None or other is None or bool(np.allclose(one, other, rtol=SAME, atol=0))


@dataclass(frozen=True)
class _Region:
    """A part of the image: what it shows, where, and in which units; what is not said is taken for 2D tissue in cm."""

    format: int
    type: int
    box: tuple[int, int, int, int]
    units: tuple[int, int]
    deltas: tuple[float, float]

    @classmethod
    def of(cls, item: Item) -> _Region:
        corners = ("MinX0", "MaxX1", "MinY0", "MaxY1")
        return cls(
            int(item.number("RegionSpatialFormat", TWO_D)),
            int(item.number("RegionDataType", TISSUE)),
            tuple(int(item.number(f"RegionLocation{corner}", -1)) for corner in corners),  # type: ignore[arg-type]
            (
                int(item.number("PhysicalUnitsXDirection", -1)),
                int(item.number("PhysicalUnitsYDirection", -1)),
            ),
            (item.number("PhysicalDeltaX", 0), item.number("PhysicalDeltaY", 0)),
        )

    @property
    def spacing(self) -> Spacing | None:
        """(u, v) mm/px; None where the axes are no lengths."""
        if self.units != (CENTIMETRES, CENTIMETRES) or 0 in self.deltas:
            return None
        return MM_PER_CM * abs(self.deltas[0]), MM_PER_CM * abs(self.deltas[1])

    def __str__(self) -> str:
        where = "" if -1 in self.box else " (u {} to {}, v {} to {})".format(*self.box)
        return f"{self.scale} in {self.what}{where}"

    @property
    def what(self) -> str:
        kind = TYPES.get(self.type, f"type {self.type}")
        return f"{FORMATS.get(self.format, f'format {self.format}')} {kind}"

    @property
    def scale(self) -> str:
        if self.spacing is not None:
            return "{:.4g} x {:.4g} mm/px".format(*self.spacing)
        u, v = (UNITS[unit] if 0 <= unit < len(UNITS) else "unknown" for unit in self.units)
        return f"units {u} x {v}"


def _regions(file: DicomFile) -> list[_Region]:
    try:
        return [_Region.of(item) for item in file.items("SequenceOfUltrasoundRegions")]
    except FormatError:  # an image is worth more than its scale
        return []


def _pixel_spacing(file: DicomFile) -> Spacing | None:
    try:
        spacing = file.numbers("PixelSpacing", 2)
    except FormatError:
        return None
    return None if spacing is None or not (spacing > 0).all() else (float(spacing[1]), float(spacing[0]))


def _unscaled(regions: Sequence[_Region]) -> tuple[Diagnostic, ...]:
    said = Diagnostic(
        code="region-scales",
        severity="info",
        message=f"no part of the image has mm/px: {'; '.join(map(str, regions))}",
        advice="take mm/px from the calibration, and compare it with the scanner's ruler",
    )
    return (said,) if regions else ()


def _differing(regions: Sequence[_Region]) -> Diagnostic:
    return Diagnostic(
        code="region-scales",
        severity="warning",
        message=f"parts of the image have different mm/px, and the image none: {'; '.join(map(str, regions))}",
        advice="use points of one part alone: a calibration holds for the pixels of the part it was made in",
    )


def _of_tissue_alone(tissue: Sequence[_Region], others: Sequence[_Region]) -> Diagnostic:
    return Diagnostic(
        code="region-scales",
        severity="info",
        message=f"mm/px are those of a part of the image, {'; '.join(map(str, tissue))}; it has other parts: "
        f"{'; '.join(map(str, others))}",
        advice="use pixels of that part alone, for the calibration as with it",
    )
