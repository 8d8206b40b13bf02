"""Images of real sweeps that were left out, against the volume of the others.

A pixel that was left out is compared with the volume at its place, linearly between voxels that are filled. "On PLUS's"
are the pixels whose nearest voxel PLUS fills, from the same images with the sweep's own device set.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import sonocal as sc
from sonocal.detection import find_mask
from sonocal.existing import read_existing
from sonocal.reconstruction import reconstruct_like_plus

DATA = Path(__file__).parents[2] / "shared" / "data"
SWEEPS = {
    "Spine": ("volumes/SpinePhantomFreehand.igs.mha", "volumes/SpinePhantom_NN_MEAN.xml", 1),
    "N-wire": (
        "recordings/NwirePhantomFreehand.igs.mha",
        "recordings/PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml",
        6,
    ),
}
EVERY_PX = 7


def left_out(_: Any) -> None:
    """For each sweep: rms and bias in grey levels, on PLUS's pixels and on all, and what share has a value."""
    for name, (sweep, devices, step) in SWEEPS.items():
        recording, calibration = sc.read_recording(DATA / sweep), read_existing(DATA / devices)
        mask = find_mask(recording.frames)
        found: dict[str, list[Any]] = {"default": [], "as PLUS": []}
        poses = recording.between("Reference", "Probe").matrices
        for k in range(1, len(recording) - 1, step):
            rest = recording.select([i for i in range(len(recording)) if i != k])
            v, u = (side[::EVERY_PX] for side in np.nonzero(mask))
            points = (poses[k] @ calibration.matrix @ np.stack([u, v, 0 * u, 1 + 0 * u]))[:3].T
            truth = recording.frames[k][v, u].astype(float)
            ours = sc.reconstruct(rest, calibration, mask=mask, coverage=True)
            plus = reconstruct_like_plus(rest, calibration, DATA / devices)
            given = (plus.coverage > 0) | (plus.values > 0)  # holes that were filled have no weight
            covered = sampled(plus, given, points)[1]
            for title, volume, filled in (
                ("default", ours, ours.coverage > 0),
                ("as PLUS", plus, given),
            ):
                value, there = sampled(volume, filled, points)
                found[title].append((value - truth, there, covered))
        for title, images in found.items():
            off, there, covered = (np.concatenate(part) for part in zip(*images, strict=True))
            both = there & covered
            print(
                f"left-out  {name}, {title}: on PLUS's pixels rms {_rms(off[both]):.2f}, bias {off[both].mean():+.2f}; "
                f"on all rms {_rms(off[there]):.2f}, bias {off[there].mean():+.2f}; {there.mean():.1%} have a value"
            )


def sampled(volume: Any, filled: Any, points_mm: Any) -> tuple[Any, Any]:
    """Values at points, linearly between filled voxels, and whether the nearest voxel is filled."""
    from scipy.ndimage import map_coordinates

    at = ((points_mm - volume.grid.origin_mm) / volume.grid.spacing_mm).T[::-1]
    nearest = np.rint(at).astype(int)
    inside = ((nearest >= 0) & (nearest < np.array(filled.shape)[:, None])).all(axis=0)
    there = inside.copy()
    there[inside] = filled[tuple(nearest[:, inside])]
    weight = map_coordinates(filled.astype(float), at, order=1)
    total = map_coordinates(volume.values * filled.astype(float), at, order=1)
    return total / np.maximum(weight, 1e-9), there


def _rms(off: Any) -> float:
    return float(np.sqrt(np.mean(off**2)))
