"""The mm/px that a recording states: in its header, or as PLUS writes them beside every image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonocal.errors import require
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.recording.model import Recording
from sonocal.recording.poses import Poses

__all__ = ["StatedScale", "stated_scale"]

# Of a scale over the images: a depth setting that was changed differs by more.
CONSTANT = 1e-4
# Of a pose's columns: these are as long as a pixel is not.
RIGID = 1e-3


@dataclass(frozen=True)
class StatedScale:
    """What is stated.

    Attributes:
        mm_per_px: along u and v, and in volumes along w.
        where: what states it, in words.
    """

    mm_per_px: tuple[float, ...]
    where: str

    __repr__ = brief

    def __str__(self) -> str:
        return f"{self.where} states {' x '.join(f'{s:.5g}' for s in self.mm_per_px)} mm/px"


def stated_scale(recording: Recording) -> StatedScale | None:
    """The mm/px that a recording states of its images; None where it does not, or where they change.

    PLUS's drivers of scanners write them, with the depth that is set, as the transform of the image to its transducer
    (``ImageToTransducerTransform``, EchoWave and others); files of images have them in their header.
    """
    require("recording", recording, Recording)
    if recording.image is None:
        return None
    for poses in recording.poses.values():
        if poses.source.lower() == "image" and (scales := _scales_of(poses)) is not None:
            found = tuple(scales.tolist()[: recording.image.dimension])
            return StatedScale(found, f"its {poses.plus_name}")
    spacing = recording.image.spacing_mm
    return None if spacing is None else StatedScale(tuple(spacing), "its header")


def _scales_of(poses: Poses) -> Array | None:
    """(3,): the columns' lengths, where they are the same throughout and not 1."""
    sound = poses.matrices[poses.valid]
    if not len(sound):
        return None
    scales = np.linalg.norm(sound[:, :3, :3], axis=1)
    middle = np.median(scales, axis=0)
    plain = np.abs(middle - 1.0).max() < RIGID or not np.all(middle > 0)
    return None if plain or np.abs(scales / middle - 1.0).max() > CONSTANT else np.asarray(middle)
