"""GE's Kretz volumes: ``.vol`` (``KRETZFILE 1.0``), alone or within a DICOM file.

The layout is not the maker's own word: open readers found it out (SlicerHeart's KretzFileReader, a placenta study's
KretzImageIO), and agree. Elements follow one another, each with group, element, length and value, little-endian.
Voxels lie along beams that fan out twice, within an image and from image to image; they are brought to cubes here.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sonocal.errors import FormatError, UnsupportedError
from sonocal.files import file_size, read_at, reading
from sonocal.files.kinds import Format
from sonocal.findings import Diagnostic
from sonocal.recording.formats.parts.toroid import Toroid, ToroidFrames
from sonocal.recording.frames import Frames, RawFrames
from sonocal.recording.model import ImageGeometry, Provenance, Recording

__all__ = ["FORMAT", "read_kretz"]

START = b"KRETZFILE 1.0   "
END_GROUP = 0xFFFF
SIZES = ((0xC000, 1), (0xC000, 2), (0xC000, 3))  # along the beam, beams of an image, images
RESOLUTION = (0xC100, 1)  # m from sample to sample
RADIUS, AXIS = (
    (0xC200, 1),
    (0xC200, 2),
)  # of the first sample, and (negative) of the axis of images, in samples
IMAGE_ANGLES, BEAM_ANGLES = (0xC300, 1), (0xC300, 2)  # rad, pi/2 in the middle
CUBE = (0x0010, 0x0022)  # mm, where the voxels are cubes already
VOXELS, SEQUENCE = (0xD000, 1), (0xD600, 1)
MM_PER_M = 1000.0
COMMONEST = 1 << 16
"""More elements than any file has."""

Tag = tuple[int, int]


def read_kretz(path: Path, start: int = 0) -> Recording:
    """Read one Kretz volume: u across the beams of an image, v away from the probe, w from image to image.

    Where the first voxel lies in the probe's frame is in the field ``Offset``, mm along u, v and w.

    Args:
        path: the file.
        start: where the volume starts in it, of a DICOM file.

    Raises:
        FormatError: an element is damaged, or missing.
        UnsupportedError: its voxels are compressed, or it holds a sequence of volumes alone.
    """
    elements = _Elements(path, start)
    sizes = tuple(int(elements.number(tag, "<H")) for tag in SIZES)
    if 0 in sizes:
        raise FormatError(
            f"{path.name}: states a volume of {' x '.join(map(str, sizes))} voxels; is it damaged?"
        )
    place = _voxels(elements, sizes)
    stored = RawFrames(path, place, 1, sizes[::-1], np.dtype("u1"), exactly=False)
    if IMAGE_ANGLES not in elements.places or BEAM_ANGLES not in elements.places:
        cube = elements.number(CUBE, "<d", np.nan)
        return _recording(path, stored, (cube,) * 3 if 0 < cube < np.inf else None, {}, ())
    toroid = _toroid(elements, sizes)
    fields = {"Offset": " ".join(map(repr, toroid.origin_mm))}
    told = Diagnostic(
        code="scan-converted",
        severity="info",
        message=f"{' x '.join(map(str, sizes))} voxels along beams were brought to cubes of {toroid.step_mm:.3g} mm, "
        "by a geometry that is not the maker's own",
        advice="compare a length that you know before you trust mm",
    )
    return _recording(path, ToroidFrames(stored, toroid), (toroid.step_mm,) * 3, fields, (told,))


def _recording(
    path: Path,
    frames: Frames,
    spacing: tuple[float, ...] | None,
    fields: dict[str, str],
    told: tuple[Diagnostic, ...],
) -> Recording:
    return Recording(
        times=np.array([np.nan]),
        frames=frames,
        image=ImageGeometry.of(frames, 3, spacing_mm=spacing),
        fields=fields,
        provenance=Provenance(path.name, "GE Kretz volume", (str(path),)),
        diagnostics=told,
    )


class _Elements:
    """Where each element of a file is: the first of each kind."""

    def __init__(self, path: Path, start: int) -> None:
        self.name, self._path = path.name, path
        if read_at(path, start, len(START)) != START:
            raise FormatError(
                f"{path.name}: does not start with {START.decode().strip()}; it is no Kretz volume"
            )
        self.places: dict[Tag, tuple[int, int]] = {}
        for tag, place in self._walk(start + len(START)):
            self.places.setdefault(tag, place)

    def _walk(self, offset: int) -> Iterator[tuple[Tag, tuple[int, int]]]:
        size = file_size(self._path)
        with reading(self._path), self._path.open("rb") as file:
            for _ in range(COMMONEST):
                file.seek(offset)
                if len(head := file.read(8)) < 8:
                    return
                group, element, length = struct.unpack("<HHI", head)
                if group == END_GROUP:
                    return
                if (offset := offset + 8 + length) > size:
                    if VOXELS in self.places:  # what stands behind a volume within another file
                        return
                    raise FormatError(
                        f"{self.name}: its element ({group:04X},{element:04X}) is longer than the file; "
                        "it was cut short, copy it again"
                    )
                yield (group, element), (offset - length, length)

    def value(self, tag: Tag, length: int) -> bytes:
        """The bytes of an element that has `length` of them.

        Raises:
            FormatError: it is absent, or has others.
        """
        place, there = self.places.get(tag, (0, 0))
        if there != length:
            raise FormatError(
                f"{self.name}: its element ({tag[0]:04X},{tag[1]:04X}) has {there} bytes where a Kretz volume "
                f"has {length}"
            )
        return read_at(self._path, place, length)

    def number(self, tag: Tag, form: str, default: float | None = None) -> float:
        """A number; the default, where there is one and it is absent."""
        if default is not None and tag not in self.places:
            return default
        return float(struct.unpack(form, self.value(tag, struct.calcsize(form)))[0])


def _voxels(elements: _Elements, sizes: tuple[int, ...]) -> int:
    """Where the voxels start."""
    if VOXELS not in elements.places:
        held = "a sequence of volumes (D600,0001)" if SEQUENCE in elements.places else "no voxels (D000,0001)"
        raise UnsupportedError(
            f"{elements.name}: is a Kretz file of GE that holds {held}, which is not read; save one volume, "
            "uncompressed, such as with 4D View, or export Cartesian DICOM or NRRD"
        )
    (place, there), wanted = elements.places[VOXELS], int(np.prod([int(n) for n in sizes], dtype=object))
    if there != wanted:
        why = "compressed" if there < wanted else "stored in a way that is not read"
        raise UnsupportedError(
            f"{elements.name}: is a Kretz volume of GE whose voxels are {why}: {there} bytes for the {wanted} of "
            f"{' x '.join(map(str, sizes))}; save it uncompressed, such as with 4D View, or export Cartesian DICOM "
            "or NRRD"
        )
    return place


def _toroid(elements: _Elements, sizes: tuple[int, ...]) -> Toroid:
    step = MM_PER_M * elements.number(RESOLUTION, "<d")
    with np.errstate(invalid="ignore"):  # what is no number is refused with the angles
        beams, images = (
            np.frombuffer(elements.value(tag, 8 * count), "<f8") - np.pi / 2
            for tag, count in ((BEAM_ANGLES, sizes[1]), (IMAGE_ANGLES, sizes[2]))
        )
    first, axis = step * elements.number(RADIUS, "<d"), -step * elements.number(AXIS, "<d")
    return Toroid(elements.name, sizes[0], step, first, axis, beams, images)


FORMAT = Format(
    name="GE Kretz volume",
    kind="recording",
    suffixes=(".vol", ".v00"),
    sniff=lambda head: head.content.startswith(START),
    read=read_kretz,
    holds="one uncompressed volume, from beams to cubes; compressed ones and sequences are refused",
)
