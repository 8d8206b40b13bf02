"""How frames lie in a file, and the recording they make: shared by the sequence formats."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.findings import Diagnostic
from sonocal.recording.formats.parts.orientation import (
    Orientation,
    image_from_file,
    oriented,
)
from sonocal.recording.formats.parts.sequence_fields import (
    ItemFields,
    interpret,
)
from sonocal.recording.frames import Frames, frame_bytes
from sonocal.recording.model import ImageGeometry, Provenance, Recording

__all__ = ["Layout", "assemble", "check_sizes"]

COUNT_LIMIT = 10_000_000
"""More items than three days of images; a larger number is damage, and memory that must not be asked for."""


@dataclass(frozen=True)
class Layout:
    """How the frames lie in a file.

    Attributes:
        name: of the file, for messages.
        size: of a stored frame, fastest axis first; a zero in it says that there are no images.
        count: items on the time line.
        channels: values a pixel.
        dtype: of the pixels, with the byte order of the file.
        spacing: as stated, fastest axis first, or None.
    """

    name: str
    size: tuple[int, ...]
    count: int
    channels: int
    dtype: np.dtype[Any]
    spacing: tuple[float, ...] | None

    def __post_init__(self) -> None:
        if not 1 <= self.channels <= 16:
            raise FormatError(
                f"{self.name}: {self.channels} channels a pixel; images have 1, or 3 for colour"
            )
        if self.count == 0:
            raise InputError(f"{self.name}: has zero frames; record it again")
        if self.count > COUNT_LIMIT:
            raise FormatError(
                f"{self.name}: states {self.count} frames, more than any recording; is it damaged?"
            )

    @property
    def image_free(self) -> bool:
        """A recording of a tracker alone."""
        return 0 in self.size

    @property
    def shape(self) -> tuple[int, ...]:
        """Of a frame's array."""
        return self.size[::-1] + ((self.channels,) if self.channels > 1 else ())

    @property
    def total_bytes(self) -> int:
        """Of all frames."""
        return self.count * frame_bytes(self.shape, self.dtype)


def check_sizes(name: str, sizes: tuple[int, ...]) -> None:
    """Refuse negative sizes."""
    if any(n < 0 for n in sizes):
        raise FormatError(
            f"{name}: its size {' '.join(map(str, sizes))} has a negative number; is it damaged?"
        )


def assemble(
    layout: Layout,
    frames: Frames,
    items: ItemFields,
    *,
    orientation: str,
    fields: Mapping[str, str],
    provenance: Provenance,
    times: np.ndarray[tuple[int], np.dtype[np.float64]] | None = None,
) -> Recording:
    """The recording of frames as stored and the fields of its header."""
    # A header that counts items without describing them would make us allocate what it never backs.
    if (layout.image_free or items.columns) and items.count < layout.count:
        raise FormatError(
            f"{layout.name}: states {layout.count} frames but describes {items.count}; it was cut short, copy it again"
        )
    meaning = interpret(items, layout.count)
    image, diagnostics, turned = None, [], frames
    if not layout.image_free:
        dimension = len(layout.size)
        known = Orientation.parse(orientation, dimension, layout.name)
        turned = oriented(frames, known, dimension)
        image = _geometry(layout, known, sequence=bool(items.columns))
        diagnostics = _remarks(known, image)
    return Recording(
        times=meaning.times if times is None else times,
        frames=turned,
        poses=meaning.poses,
        image=image,
        image_valid=meaning.image_valid & (not layout.image_free),
        fields=fields,
        item_fields=meaning.others,
        provenance=provenance,
        diagnostics=tuple(diagnostics),
    )


def _geometry(layout: Layout, orientation: Orientation, sequence: bool) -> ImageGeometry:
    size = tuple(int(n) for n in orientation.reorder(layout.size))
    spacing = layout.spacing
    if spacing is not None and (
        (sequence and set(spacing) == {1.0}) or not all(0 < s < np.inf for s in spacing)
    ):
        spacing = None  # PLUS's "not known", or nonsense
    return ImageGeometry(
        size_px=size,
        channels=layout.channels,
        dtype=layout.dtype.newbyteorder("=").name,
        orientation=orientation.code,
        image_from_file=image_from_file(orientation, size),
        spacing_mm=None if spacing is None else orientation.reorder(spacing),
    )


def _remarks(orientation: Orientation, image: ImageGeometry) -> list[Diagnostic]:
    if not orientation.known:
        return [
            Diagnostic(
                code="orientation-unknown",
                severity="info",
                message="the file does not say how its images are oriented; they are taken as stored: u right, v down",
                advice="compare an image with the scanner's screen; state UltrasoundImageOrientation if it is flipped",
            )
        ]
    if orientation.changes(image.dimension):
        return [
            Diagnostic(
                code="orientation-changed",
                severity="info",
                message=f"the images are stored as {orientation.code} and were brought to MF, u right and v down",
                advice="pixel positions of other programs that show the stored image need image_from_file first",
            )
        ]
    return []
