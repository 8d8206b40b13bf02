"""A volume equal to PLUS's, to the voxel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal import _core
from sonocal.calibration import Calibration
from sonocal.errors import InputError, UnsupportedError, require
from sonocal.existing import Existing
from sonocal.geometry import Array
from sonocal.reconstruction.grid import Grid, grid_of_size
from sonocal.reconstruction.options import Options
from sonocal.reconstruction.placed import Placed, image_matrix, place
from sonocal.reconstruction.plus_settings import PlusSettings, read_plus_settings
from sonocal.reconstruction.volume import Volume
from sonocal.recording import Recording
from sonocal.recording.formats import read_recording
from sonocal.recording.poses import OnInvalid
from sonocal.targets.device_set import read_device_set

__all__ = ["reconstruct_like_plus"]

Report = Callable[[int, int], None]
PIXEL = 256
"""What PLUS adds to a voxel's weight for a pixel."""


def reconstruct_like_plus(
    recording: Recording,
    calibration: Calibration | Existing | ArrayLike,
    device_set: str | Path,
    *,
    probe: str = "Probe",
    on_invalid: OnInvalid = "raise",
    progress: Report | None = None,
) -> Volume:
    """The volume that PLUS makes of a sweep, voxel for voxel, as its device set says.

    Grey levels carry PLUS's own rounding: its mean over nearest neighbours cuts off the remainder at each pixel. For
    the best volume take `reconstruct`.

    Args:
        recording: the images of a 2D probe, 8 bits deep, and its poses.
        calibration: as `reconstruct`.
        device_set: the XML with an element VolumeReconstruction; its constant transforms are used, too.
        probe: the tool that the probe's marker is called.
        on_invalid: what to do with poses marked valid that are not rigid: "raise" or "skip".
        progress: told of images done and of all images.

    Returns:
        The volume.

    Raises:
        InputError: no image has a pose, or the device set cannot be used.
        UnsupportedError: it asks for what is not done as PLUS does, or images are not 8 bits deep.
    """
    require("recording", recording, Recording)
    settings = read_plus_settings(device_set)
    fixed = dict(read_device_set(device_set).transforms)
    options = Options(probe=probe, reference=settings.reference, fixed=fixed, on_invalid=on_invalid)
    placed = place(recording, image_matrix(calibration), options)
    if placed.slices > 1:
        raise UnsupportedError(
            f"{recording.name}: holds volumes of a 3D probe, of which PLUS makes none; leave like_plus out"
        )
    if placed.dtype != np.uint8:
        raise UnsupportedError(f"{recording.name}: volumes are made as PLUS makes them of images of 8 bits")
    left_out = len(recording) - len(placed)
    placed = _every(placed, settings.every)
    grid = _grid(placed, settings)
    values, weights = np.zeros(grid.shape, np.uint8), np.zeros(grid.shape, np.uint16)
    _insert(placed, grid, settings, (values, weights), progress or (lambda done, total: None))
    values, filled = _without_holes(values, weights, settings)
    coverage = (weights + np.uint32(PIXEL - 1)) // PIXEL
    return Volume(
        values,
        grid,
        placed.reference,
        len(placed),
        left_out,
        filled,
        coverage.astype(np.uint16),
        source=placed.name,
    )


def _every(placed: Placed, every: int) -> Placed:
    rows = placed.rows % every == 0
    return replace(placed, rows=placed.rows[rows], reference_from_image=placed.reference_from_image[rows])


def _grid(placed: Placed, settings: PlusSettings) -> Grid:
    """As PLUS finds it: from the least corner on, so many voxels as fit, and one."""
    if settings.origin_mm is not None and settings.extent is not None:
        return grid_of_size(settings.origin_mm, settings.spacing_mm, settings.extent, placed.name)
    low, high = np.zeros(2), np.array([placed.width - 1.0, placed.height - 1.0])
    origin, size = np.array(settings.clip_origin_px), np.array(settings.clip_size_px)
    if (size > 0).all():
        low, high = np.maximum(low, origin), np.minimum(high, origin + size)
    corners = placed.corners_mm(low, high).reshape(-1, 3)
    least, greatest = corners.min(axis=0), corners.max(axis=0)
    size = np.floor((greatest - least) / settings.spacing_mm + (0.0 if settings.truncates else 0.5)) + 1
    return grid_of_size(least, settings.spacing_mm, size, placed.name)


def _insert(
    placed: Placed,
    grid: Grid,
    settings: PlusSettings,
    into: tuple[NDArray[np.uint8], NDArray[np.uint16]],
    report: Report,
) -> None:
    matrices = _checked(placed, np.linalg.inv(grid.reference_from_voxel) @ placed.reference_from_image)
    importance = _importance(placed, settings)
    said: dict[str, Any] = {
        "compounding": settings.compounding,
        "optimization": settings.optimization,
        "linear": settings.linear,
        "clip_origin": settings.clip_origin_px,
        "clip_size": settings.clip_size_px,
        "fan_angles_deg": settings.fan_angles_deg,
        "fan_origin": settings.fan_origin_px,
        "fan_radii": settings.fan_radii_px,
        "rejection": settings.rejection,
    }
    for i, image in enumerate(placed.pixels(0, len(placed))):
        _core.plus_insert(*into, image, np.ascontiguousarray(matrices[i, :3]), importance, **said)
        report(i + 1, len(placed))


def _checked(placed: Placed, matrices: Array) -> Array:
    """PLUS's fixed point holds numbers up to 2^17: what it would add up wrong is refused."""
    most = 1 << 15
    size = np.array([placed.width, placed.height, 0.0, 1.0])
    beyond = np.flatnonzero((np.abs(matrices[:, :3] * size) >= most).any(axis=(1, 2)))
    if len(beyond):
        raise InputError(
            f"{placed.name}, frame {placed.rows[beyond[0]]}: lies further than {most} voxels from the volume; leave "
            "it out"
        )
    return matrices


def _importance(placed: Placed, settings: PlusSettings) -> NDArray[np.uint8] | None:
    if settings.compounding != "IMPORTANCE_MASK":
        return None
    if settings.importance is None:
        raise InputError(
            f"{settings.name}: IMPORTANCE_MASK needs ImportanceMaskFilename, an image of the frames' size"
        )
    drawn = read_recording(settings.importance)
    if (
        len(drawn.frames) != 1
        or drawn.frames.shape != (placed.height, placed.width)
        or drawn.frames.dtype != np.uint8
    ):
        raise InputError(
            f"{settings.importance.name}: the importance mask is one grey image of {placed.width} x {placed.height} px "
            "and 8 bits"
        )
    return np.ascontiguousarray(drawn.frames[0])


def _without_holes(
    values: NDArray[np.uint8], weights: NDArray[np.uint16], settings: PlusSettings
) -> tuple[NDArray[np.uint8], int]:
    """The volume with its holes filled, and how many voxels an image was in."""
    filled = int(np.count_nonzero(weights))
    if not settings.sticks:
        return values, filled
    if len(settings.sticks) > 1:
        raise UnsupportedError(
            f"{settings.name}: holes are filled with one HoleFillingElement, and it has several"
        )
    result = np.empty_like(values)
    _core.plus_fill_sticks(values, weights, settings.sticks[0].limit, settings.sticks[0].most, result)
    return result, filled
