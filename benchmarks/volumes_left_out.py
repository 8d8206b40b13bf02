"""Images of real sweeps that were left out, against the volume of the others.

A pixel that was left out is compared with the volume at its place, linearly between voxels that are filled. "On PLUS's"
are the pixels whose nearest voxel PLUS fills, from the same images with the sweep's own device set. "At best" is no
volume: it is the mixture of the neighbouring images' own pixels, sharp and blurred, whose weights were fitted to the
very image that was left out. What is between neighbours alone cannot be known better.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import sonocal as sc
from sonocal import _core
from sonocal.detection import find_mask
from sonocal.existing import read_existing
from sonocal.reconstruction import reconstruct_like_plus
from sonocal.reconstruction.plus_settings import read_plus_settings

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
BLURS_PX = (0, 2, 4, 8)
FURTHEST_NEIGHBOUR = 2


def left_out(_: Any) -> None:
    """For each sweep: rms and bias in grey levels, on PLUS's pixels and on all, and what share has a value."""
    for name, (sweep, devices, step) in SWEEPS.items():
        recording, calibration = sc.read_recording(DATA / sweep), read_existing(DATA / devices)
        mask = find_mask(recording.frames)
        found: dict[str, list[Any]] = {"default": [], "as PLUS": []}
        poses = recording.between("Reference", "Probe").matrices
        at: dict[int, Any] = {}
        for k in range(1, len(recording) - 1, step):
            rest = recording.select([i for i in range(len(recording)) if i != k])
            v, u = (side[::EVERY_PX] for side in np.nonzero(mask))
            points = (poses[k] @ calibration.matrix @ np.stack([u, v, 0 * u, 1 + 0 * u]))[:3].T
            truth = recording.frames[k][v, u].astype(float)
            ours = sc.reconstruct(rest, calibration, mask=mask, coverage=True)
            plus = reconstruct_like_plus(rest, calibration, DATA / devices)
            given = filled_by_plus(plus, DATA / devices)
            at[k] = (v, u, sampled(plus, given, points)[1])
            for title, volume, filled in (
                ("default", ours, ours.coverage > 0),
                ("as PLUS", plus, given),
            ):
                value, there = sampled(volume, filled, points)
                found[title].append((value - truth, there, at[k][2]))
        for title, images in found.items():
            off, there, covered = (np.concatenate(part) for part in zip(*images, strict=True))
            both = there & covered
            print(
                f"left-out  {name}, {title}: on PLUS's pixels rms {_rms(off[both]):.2f}, bias {off[both].mean():+.2f}; "
                f"on all rms {_rms(off[there]):.2f}, bias {off[there].mean():+.2f}; {there.mean():.1%} have a value"
            )
        print(f"left-out  {name}, at best: {_at_best(recording, at)}")


def filled_by_plus(volume: Any, devices: Path) -> Any:
    """The voxels that PLUS gave a value, and be it 0: by an image, or by a stick across a hole."""
    sticks, weights = read_plus_settings(devices).sticks, volume.coverage
    if not sticks:
        return weights > 0
    # White where an image was: what is not black then was filled.
    white, result = np.where(weights > 0, 255, 0).astype(np.uint8), np.empty(weights.shape, np.uint8)
    _core.plus_fill_sticks(white, weights, sticks[0].limit, sticks[0].most, result)
    return result > 0


def _at_best(recording: Any, at: dict[int, Any]) -> str:
    """The rms of the best mixture, of each image's pixels (v, u) and which of them are PLUS's."""
    from scipy.ndimage import gaussian_filter

    ends = range(FURTHEST_NEIGHBOUR, len(recording) - FURTHEST_NEIGHBOUR)
    asked = {k: pixels for k, pixels in at.items() if k in ends}
    parts: dict[int, list[Any]] = {k: [] for k in asked}
    for blur in BLURS_PX:
        images = [gaussian_filter(np.asarray(image, dtype=float), blur) for image in recording.frames]
        for k, (v, u, _) in asked.items():
            for near in range(1, FURTHEST_NEIGHBOUR + 1):
                parts[k].append((images[k - near][v, u] + images[k + near][v, u]) / 2)
    rows = np.concatenate([np.stack([*parts[k], np.ones(len(asked[k][0]))], axis=1) for k in asked])
    truth = np.concatenate([recording.frames[k][v, u].astype(float) for k, (v, u, _) in asked.items()])
    covered = np.concatenate([pixels[2] for pixels in asked.values()])
    rms = {}
    for title, which in (("on PLUS's pixels", covered), ("on all", np.ones(len(truth), dtype=bool))):
        weights = np.linalg.lstsq(rows[which], truth[which], rcond=None)[0]
        rms[title] = _rms(rows[which] @ weights - truth[which])
    return "; ".join(f"{title} rms {value:.2f}" for title, value in rms.items())


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
