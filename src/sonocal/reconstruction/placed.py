"""Images of a sweep and where each of them was."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.calibration import Calibration
from sonocal.errors import InputError, UnsupportedError
from sonocal.existing import Existing
from sonocal.geometry import Array, AxisScaled, Similarity, real_array
from sonocal.reconstruction.options import Options
from sonocal.reconstruction.smoothing import smoothed_poses
from sonocal.recording import Frames, Poses, Recording

__all__ = ["Placed", "image_matrix", "place", "reference_of"]

# Weights of red, green and blue of a grey level, in 2^16 parts (ITU-R BT.601).
LUMA = np.array([19595, 38470, 7471], dtype=np.uint32)


@dataclass(frozen=True, eq=False)
class Placed:
    """Images that have a pose.

    Attributes:
        name: of the recording, for messages.
        frames: all its images.
        rows: (n,), which of them have a pose.
        reference_from_image: (n, 4, 4), mm from px.
        reference: the frame of these.
        slices: how many of them in succession are those of one volume of a 3D probe; 1 of a 2D probe.
    """

    name: str
    frames: Frames
    rows: NDArray[np.int64]
    reference_from_image: Array
    reference: str
    slices: int = 1

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def items(self) -> int:
        """How many images, or volumes, of the recording they are."""
        return len(self.rows) // self.slices

    @property
    def height(self) -> int:
        """Rows of an image."""
        return self.frames.shape[0]

    @property
    def width(self) -> int:
        """Columns of an image."""
        return self.frames.shape[1]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the volume's voxels."""
        return np.dtype(np.uint16 if self.frames.dtype == np.uint16 else np.uint8)

    def corners_mm(self, low: Array, high: Array) -> Array:
        """(n, 4, 3): where the corners of a rectangle of the image (px) were."""
        (left, top), (right, bottom) = low, high
        px = np.array(
            [[left, top, 0, 1], [left, bottom, 0, 1], [right, top, 0, 1], [right, bottom, 0, 1]], float
        )
        return np.asarray(np.einsum("nij,cj->nci", self.reference_from_image, px)[..., :3])

    def pixels(self, start: int, stop: int) -> Iterator[NDArray[Any]]:
        """Images start <= i < stop of those that have a pose, as grey levels [v, u]."""
        for row in self.rows[start:stop]:
            yield grey_levels(self.frames[int(row)])


class Slices(Frames):
    """The slices of volumes [w, v, u], one after the other, of one volume after the other."""

    def __init__(self, volumes: Frames) -> None:
        self._volumes = volumes
        self.depth, *shape = volumes.shape
        self.shape, self.dtype = tuple(shape), volumes.dtype
        self._last: tuple[int, NDArray[Any]] | None = None

    def __len__(self) -> int:
        return len(self._volumes) * self.depth

    def read(self, index: int) -> NDArray[Any]:
        """Slice `index`; a volume is decoded once for all of its slices."""
        which, w = divmod(index, self.depth)
        last = self._last
        if last is None or last[0] != which:
            last = self._last = (which, self._volumes.read(which))
        return np.asarray(last[1][w])


def grey_levels(image: NDArray[Any]) -> NDArray[Any]:
    """An image as one grey level a pixel, of the depth that it came in."""
    if image.ndim == 3:
        parts = image[..., :3].astype(np.uint32) @ LUMA
        image = ((parts + (1 << 15)) >> 16).astype(image.dtype)
    return np.ascontiguousarray(image.view(np.uint8) if image.dtype == np.bool_ else image)


def image_matrix(calibration: Calibration | Existing | ArrayLike) -> Array:
    """(4, 4): mm in the probe marker's frame from px, of whatever says so.

    Raises:
        InputError: it is none of these.
    """
    if isinstance(calibration, Calibration):
        return calibration.probe_from_image.matrix
    if isinstance(calibration, (Existing, AxisScaled, Similarity)):
        return calibration.matrix
    matrix = real_array("calibration", calibration)
    usable = matrix.shape == (4, 4) and bool(np.isfinite(matrix).all())
    if not usable or not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise InputError(
            "calibration must be a calibration (see load), a matrix of other software (see "
            f"sonocal.existing.read_existing), or 4 x 4 numbers with the last row 0 0 0 1; got {calibration!r}"[
                :300
            ]
        )
    return matrix


def reference_of(recording: Recording, options: Options) -> str:
    """The frame of the volume: as asked, or "Reference" where something leads there, or else the tracker's."""
    if options.reference is not None:
        return options.reference
    names = {name.lower() for poses in recording.poses.values() for name in (poses.source, poses.target)}
    if "reference" in names and options.probe.lower() != "reference":
        return "Reference"
    return recording.tool(options.probe).target


def place(recording: Recording, matrix: Array, options: Options, poses: Poses | None = None) -> Placed:
    """The images that have a pose.

    Args:
        recording: images and poses.
        matrix: (4, 4), mm in the probe marker's frame from px.
        options: how.
        poses: reference_from_probe, where they are not the recording's own.

    Raises:
        InputError: there are no images, or none with a pose.
        UnsupportedError: images of this kind are not put into volumes.
    """
    _check_images(recording)
    if poses is None:
        reference = reference_of(recording, options)
        poses = recording.between(reference, options.probe, options.fixed, options.on_invalid)
        if options.smooth:
            poses = smoothed_poses(poses, recording.times, options.noise_mm, options.noise_deg)
    usable = poses.valid & recording.image_valid
    if not usable.any():
        raise InputError(
            f"{recording.name}: none of its {len(recording)} images has a valid pose of {options.probe} in "
            f"{poses.target}; check which tools were seen with sonocal info"
        )
    rows = np.flatnonzero(usable)
    placed = Placed(recording.name, recording.frames, rows, poses.matrices[rows] @ matrix, poses.target)
    assert recording.image is not None
    return placed if recording.image.dimension == 2 else _sliced(placed)


def _sliced(placed: Placed) -> Placed:
    """Volumes of a 3D probe as the images that they are a stack of."""
    frames = Slices(placed.frames)
    shifts = np.tile(np.eye(4), (frames.depth, 1, 1))
    shifts[:, 2, 3] = np.arange(frames.depth)
    rows = placed.rows[:, None] * frames.depth + np.arange(frames.depth)
    matrices = placed.reference_from_image[:, None] @ shifts
    return Placed(
        placed.name, frames, rows.ravel(), matrices.reshape(-1, 4, 4), placed.reference, frames.depth
    )


def _check_images(recording: Recording) -> None:
    if recording.image is None or not len(recording.frames):
        raise InputError(
            f"{recording.name}: has no images; a volume is made of a recording of images and poses"
        )
    if recording.frames.dtype not in (np.uint8, np.uint16, np.bool_):
        raise UnsupportedError(
            f"{recording.name}: pixels of type {recording.frames.dtype.name} are not put into volumes; convert them to "
            "uint8 or uint16"
        )
    if min(recording.frames.shape[recording.image.dimension - 2 :][:2]) < 2:
        raise InputError(
            f"{recording.name}: its images are a single line of pixels; there is nothing between lines"
        )
