"""Volumes: equal to PLUS's, exact, quick, small in memory, and close to images that were left out.

python -m benchmarks.volumes [PART ...] [--seeds N] [--first-seed N]

Parts: equal, exact, speed, live, large, left-out, smoothing, error; all of them where none is named. Real sweeps are
read from ../shared/data; simulated ones are of a field whose grey level is known (`benchmarks.simulators.fields`).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import sonocal as sc
from benchmarks.simulators.fields import grey_at, path, probe_from_image, recorded
from benchmarks.volumes_error import error
from benchmarks.volumes_large import large
from benchmarks.volumes_left_out import left_out
from benchmarks.volumes_live import live
from sonocal import _core
from sonocal.existing import read_existing
from sonocal.reconstruction import making, pieces, reconstruct_like_plus
from sonocal.reconstruction.options import Options
from sonocal.reconstruction.placed import place

DATA = Path(__file__).parents[2] / "shared" / "data"
SPINE = "volumes/SpinePhantomFreehand.igs.mha"
NWIRE = "recordings/NwirePhantomFreehand.igs.mha"
NWIRE_SET = "recordings/PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml"
REFERENCES = {
    "nearest, latest, clip and fan": (SPINE, "volumes/SonixRP_TRUS_D70mm_NN_LATE.xml", "NNLATE"),
    "nearest, mean, sticks": (SPINE, "volumes/SpinePhantom_NN_MEAN.xml", "NNMEAN"),
    "linear, maximum": (SPINE, "volumes/SpinePhantom_LN_MAXI.xml", "LNMAXI"),
    "N-wire: linear, mean, clip": (NWIRE, NWIRE_SET, None),
}
MASK = np.ones((80, 100), dtype=bool)
RUNS = 5


def equal(_: Any) -> None:
    """Shares of voxels that are PLUS's."""
    for name, (sweep, devices, reference) in REFERENCES.items():
        stem = (
            f"volumes/vtkVolumeReconstructorTest{reference}volumeRef"
            if reference
            else NWIRE[:-8] + "Reconstructed"
        )
        there = sc.read_recording(DATA / f"{stem}.mha")
        made = reconstruct_like_plus(
            sc.read_recording(DATA / sweep), read_existing(DATA / devices), DATA / devices
        )
        off = np.abs(made.grid.origin_mm - np.array(there.fields["Offset"].split(), dtype=float)).max()
        same = made.values == there.frames[0]
        print(f"equal     {name}: {same.mean():.4%} of {same.size} voxels, origin within {off:.5f} mm")


def exact(_: Any) -> None:
    """The default's mean against exact arithmetic, and PLUS's, in one volume."""
    recording, devices = sc.read_recording(DATA / SPINE), DATA / "volumes/SpinePhantom_NN_MEAN.xml"
    calibration = read_existing(devices)
    mask = np.ones(recording.frames.shape, dtype=bool)
    like = reconstruct_like_plus(recording, calibration, devices)
    end = like.grid.origin_mm + like.grid.spacing_mm * (np.array(like.grid.size) - 1)
    bounds = [like.grid.origin_mm, end + 1e-3]
    ours = sc.reconstruct(
        recording, calibration, interpolation="nearest", mask=mask, coverage=True, bounds_mm=bounds
    )
    sums, counts = np.zeros(ours.values.shape), np.zeros(ours.values.shape)
    v, u = np.mgrid[: mask.shape[0], : mask.shape[1]]
    pixels = np.stack([u.ravel(), v.ravel(), 0 * u.ravel(), 1 + 0 * u.ravel()]).astype(float)
    placed = place(recording, calibration.matrix, Options())
    for matrix, image in zip(placed.reference_from_image, recording.frames, strict=True):
        at = ((matrix @ pixels)[:3].T - ours.grid.origin_mm) / ours.grid.spacing_mm
        index = np.floor(at + 0.5).astype(int)
        ok = ((index >= 0) & (index < ours.grid.size)).all(axis=1)
        x, y, z = index[ok].T
        np.add.at(sums, (z, y, x), image.ravel()[ok])
        np.add.at(counts, (z, y, x), 1)
    known = counts > 0
    truth = sums[known] / counts[known]
    for name, volume in (("default", ours), ("as PLUS", like)):
        off = volume.values[known] - truth
        bright = off[(truth > 128) & (counts[known] > 3)].mean()
        print(
            f"exact     {name}: at most {np.abs(off).max():.3f} grey levels off, {bright:+.2f} on average where bright"
        )


def speed(_: Any) -> None:
    """Images a second of processor time, 820 x 616 into 0.5 mm, beside PLUS's arithmetic."""
    recording, calibration = (
        sc.read_recording(DATA / SPINE),
        read_existing(DATA / "volumes/SpinePhantom_NN_MEAN.xml"),
    )
    rates = {}
    for mode, speckle in (
        ("nearest", "kept"),
        ("linear", "kept"),
        ("between", "kept"),
        ("between", "averaged"),
    ):
        options = Options(
            interpolation=mode, speckle=speckle, mask=np.ones(recording.frames.shape, dtype=bool)
        )
        images = making._crossing(place(recording, calibration.matrix, options), options)
        kept = np.stack(list(images.placed.pixels(0, len(recording))))
        parts = [pieces.new_piece(box, options) for box in pieces.boxes_of(images.grid, 1)]

        def insert(
            images: Any = images, kept: Any = kept, parts: Any = parts, averages: bool = speckle == "averaged"
        ) -> None:
            from sonocal.reconstruction.speckle import averaged_over

            if averages:
                kept = np.stack([averaged_over(image, (6, 6)) for image in kept])
            batch = images.batch(0, len(kept), kept)
            for part in parts:
                part.insert(batch)

        rates[f"{mode}, speckle {speckle}"] = len(kept) / _least(insert)
    for linear in (False, True):
        values, weights = np.zeros(images.grid.shape, np.uint8), np.zeros(images.grid.shape, np.uint16)
        said = dict.fromkeys(
            ("clip_origin", "clip_size", "fan_angles_deg", "fan_origin", "fan_radii"), (0.0, 0.0)
        )

        def plus(
            values: Any = values, weights: Any = weights, linear: bool = linear, said: Any = said
        ) -> None:
            for image, matrix in zip(kept, images.voxel_from_pixel, strict=True):
                _core.plus_insert(
                    values, weights, image, matrix, None, compounding="MEAN", optimization="FULL", linear=linear,
                    rejection=-1.0, **said,
                )  # fmt: skip

        rates[f"as PLUS, {'linear' if linear else 'nearest'}"] = len(kept) / _least(plus)
    for name, rate in rates.items():
        print(f"speed     {name}: {rate:.0f} images/s")
    print(
        f"speed     nearest: {rates['nearest, speckle kept'] / rates['as PLUS, nearest']:.2f} times as PLUS"
    )
    print(f"speed     linear: {rates['linear, speckle kept'] / rates['as PLUS, linear']:.2f} times as PLUS")


def _least(work: Callable[[], None]) -> float:
    took = []
    for _ in range(RUNS):
        start = time.process_time()
        work()
        took.append(time.process_time() - start)
    return min(took)


def smoothing(seeds: range) -> None:
    """A field that is known, poses with 0.3 mm and 0.3 deg of jitter: rms of grey levels as they are, and smoothed."""
    rms: dict[bool, list[float]] = {False: [], True: []}
    for seed in seeds:
        sweep = recorded(path(100, step_mm=0.4), jitter=(0.3, 0.3), seed=seed)
        for smooth, found in rms.items():
            volume = sc.reconstruct(
                sweep,
                probe_from_image(),
                mask=MASK,
                coverage=True,
                noise_mm=0.3,
                noise_deg=0.3,
                smooth=smooth,
            )
            there = volume.coverage > 0
            z, y, x = np.nonzero(there)
            points = np.stack([x, y, z], axis=1) * volume.grid.spacing_mm + volume.grid.origin_mm
            found.append(float(np.sqrt(np.mean((volume.values[there] - grey_at(points)) ** 2))))
    raw, smooth = np.mean(rms[False]), np.mean(rms[True])
    print(
        f"smoothing {len(seeds)} sweeps: rms {raw:.2f} as they are, {smooth:.2f} smoothed: {smooth / raw - 1:+.0%}"
    )


PARTS = {
    "equal": equal, "exact": exact, "speed": speed, "live": live, "large": large, "left-out": left_out,
    "smoothing": smoothing, "error": error,
}  # fmt: skip


def main() -> None:
    """Print the parts that were asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=1000)
    told = parser.parse_args()
    seeds = range(told.first_seed, told.first_seed + told.seeds)
    for part in told.parts or PARTS:
        PARTS[part](seeds)


if __name__ == "__main__":
    main()
