"""From a calibrated sweep to a volume: the whole path."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.calibration import Calibration
from sonocal.detection import find_mask
from sonocal.errors import InputError, UnsupportedError, require
from sonocal.existing import Existing
from sonocal.geometry import Array
from sonocal.reconstruction.batches import Crossing, Images, crossing
from sonocal.reconstruction.grid import Grid, given_spacing, grid_around, grid_within
from sonocal.reconstruction.options import Options, options_of
from sonocal.reconstruction.pieces import BYTES_A_VOXEL, SIDE, Batch, Piece, boxes_of, new_piece
from sonocal.reconstruction.placed import Placed, image_matrix, place
from sonocal.reconstruction.spread import Workforce, crosses, fill_by
from sonocal.reconstruction.store import Store, beside_volume, in_file, in_memory
from sonocal.reconstruction.sureness import Repeated, error_image_um, refuse_unknown_error
from sonocal.reconstruction.volume import Volume
from sonocal.recording import Recording

__all__ = ["reconstruct"]

Report = Callable[[int, int], None]
SUMS_BYTES = 128 << 20
"""Of pieces that are filled at a time; the images are gone through once for each such group."""


def reconstruct(
    recording: Recording,
    calibration: Calibration | Existing | ArrayLike,
    path: str | Path | None = None,
    *,
    workers: Workforce | None = None,
    progress: Report | None = None,
    **options: Any,
) -> Volume:
    """The volume of a sweep.

    Args:
        recording: the images of a 2D probe, or the volumes of a 3D probe, and its poses.
        calibration: ours, a matrix of other software, or (4, 4) mm in the probe marker's frame from px.
        path: ``.mha`` or ``.nrrd``: the volume is written there brick by brick, and never whole in memory.
        workers: who fills the bricks, such as those of `sonocal.studies.cluster.local(4)`; None: this process. The
            volume is the same. They must see the folder of `path`, where decoded images wait for them.
        progress: told of steps done and of all steps.
        **options: those of `Options`, such as ``spacing_mm=0.3``.

    Returns:
        The volume; of one that was written, `values` are read from the file as they are asked for.

    Raises:
        InputError: no image has a pose, the volume would have too many voxels, no image crosses it, or it cannot be
            written. Then nothing is written.
        UnsupportedError: images of this kind are not put into volumes.
    """
    require("recording", recording, Recording)
    settings = options_of(options)
    matrix = image_matrix(calibration)
    refuse_unknown_error(calibration, settings)
    placed = place(recording, matrix, settings)
    if settings.error and placed.slices > 1:
        raise UnsupportedError(
            f"{recording.name}: how far off a voxel is, is not told of the volumes of a 3D probe; leave error out"
        )
    images = _crossing(placed, settings)
    report = progress or (lambda done, total: None)
    fill = partial(_fill, report=report)
    if workers is not None:
        folder = Path(tempfile.gettempdir()) if path is None else Path(path).absolute().parent
        fill = partial(fill_by, workers, folder=folder, report=report)
    with ExitStack() as stack:
        into = stack.enter_context(_store(path)(images.grid, placed, settings))
        filled = fill(images, into)
        errors = None
        if settings.error:
            errors = stack.enter_context(_store(path, "error-um")(*_error_channel(images)))
            fill(_of_errors(images, error_image_um(calibration, placed, settings)), errors)
    volume: Volume = into.volume(placed.items, len(recording) - placed.items, filled)
    return volume if errors is None else replace(volume, error_um=errors.read()[0])


def _store(path: str | Path | None, what: str = "") -> Any:
    if path is None:
        return in_memory
    return in_file(beside_volume(Path(path), what) if what else Path(path))


def _error_channel(images: Crossing) -> tuple[Grid, Placed, Options]:
    """What the store of errors is made for: as many voxels, of 16 bits."""
    levels = Repeated(np.empty((images.placed.height, images.placed.width), np.uint16), 0)
    return images.grid, replace(images.placed, frames=levels), replace(images.options, coverage=False)


def _of_errors(images: Crossing, error_um: NDArray[np.uint16]) -> Crossing:
    """The same images where each pixel shows how far off it is: they go the same way into voxels."""
    frames = Repeated(error_um, len(images.placed.frames))
    options = replace(images.options, speckle="kept", compounding="mean")
    return replace(images, placed=replace(images.placed, frames=frames), options=options)


def _crossing(placed: Placed, options: Options) -> Crossing:
    """Where the voxels lie, and the images across them."""
    mask = _mask(placed, options)
    rows, columns = np.nonzero(mask)
    corners = placed.corners_mm(np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()]))
    spacing = given_spacing(options.spacing_mm)
    if options.bounds_mm is None:
        grid = grid_around(corners.reshape(-1, 3), spacing, placed.name)
    else:
        grid = grid_within(options.bounds_mm, spacing, placed.name)
        _refuse_beside(placed, grid, corners)
    return crossing(placed, grid, options, mask, corners)


def _mask(placed: Placed, options: Options) -> NDArray[np.bool_]:
    if options.mask is None:
        return find_mask(placed.frames, 2, placed.name)
    mask = np.asarray(options.mask)
    if mask.shape != (placed.height, placed.width) or mask.dtype != np.bool_ or not mask.any():
        raise InputError(
            f"mask must be {placed.width} x {placed.height} px as the images of {placed.name}, True where they show "
            f"ultrasound, and not empty; got {mask.dtype} of shape {mask.shape}"
        )
    return mask


def _refuse_beside(placed: Placed, grid: Grid, corners_mm: Array) -> None:
    low, high = corners_mm.min(axis=1), corners_mm.max(axis=1)
    end = grid.origin_mm + grid.spacing_mm * (np.array(grid.size) - 1)
    if ((high >= grid.origin_mm) & (low <= end)).all(axis=1).any():
        return
    around = " x ".join(f"{a:.0f} to {b:.0f}" for a, b in zip(low.min(axis=0), high.max(axis=0), strict=True))
    raise InputError(
        f"{placed.name}: none of its {len(placed)} images crosses bounds_mm; they lie at {around} mm in "
        f"{placed.reference}"
    )


def _fill(images: Crossing, into: Store, report: Report) -> int:
    """Fill the store, group of pieces by group of pieces; how many voxels were given something."""
    boxes = list(boxes_of(images.grid, images.options.threads))
    a_group = max(1, SUMS_BYTES // (BYTES_A_VOXEL[images.options.interpolation] * SIDE**3))
    whole = max(1, SIDE // min(box[1][2] for box in boxes))
    groups = [boxes[i : i + a_group * whole] for i in range(0, len(boxes), a_group * whole)]
    ranges = list(images.ranges())
    kept = Images(images, again=len(groups) > 1)
    filled, steps = 0, len(groups) * len(ranges)
    try:
        with ThreadPoolExecutor(images.options.threads) as pool:
            for number, group in enumerate(groups):
                pieces = [new_piece(box, images.options) for box in group]
                for k, (start, stop) in enumerate(ranges):
                    if number == 0 or crosses(images, group, start, stop):
                        batch = images.batch(start, stop, kept.read(start, stop))
                        _all(pool, partial(_insert, batch), pieces)
                    report(number * len(ranges) + k + 1, steps)
                filled += sum(_all(pool, partial(_settle, into), pieces))
                del pieces  # before the next are made
    finally:
        kept.close()
    return filled


def _all(pool: ThreadPoolExecutor, work: Callable[[Piece], Any], pieces: list[Piece]) -> list[Any]:
    return list(pool.map(work, pieces))


def _insert(batch: Batch, piece: Piece) -> None:
    piece.insert(batch)


def _settle(into: Store, piece: Piece) -> int:
    values, counts = piece.settle(into.values.dtype)
    into.put(piece.place, values, counts)
    return int(np.count_nonzero(counts))
