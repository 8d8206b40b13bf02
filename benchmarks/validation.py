"""Whether validation's confidence intervals hold the true values, and what PLUS's error is on PLUS's data.

python -m benchmarks.validation [--scenes 2000] [--data FOLDER] [--workers 2]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.calibration import line_distances
from sonocal.geometry import AxisScaled
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import (
    PointSightings,
    Quantity,
    compare,
    fit_crosswire,
    fixed_point_spread,
    held_out,
    leave_one_frame_out,
    leave_one_target_out,
    nwire_error,
    reconstruction_accuracy,
    repeatability,
    validate,
)
from sonocal.validation.held_out import refitted

FITTED, HELD_OUT, ENDLESS = 50, 40, 3000
IMAGE = (500, 500)
NWIRES = [("a", "b", "c"), ("d", "e", "f"), ("g", "h", "i")]

# A scene gives (low, high, true value) by code; None stands for a value that only all scenes together know.
Row = tuple[float, float, float]


def scene(seed: int) -> dict[str, Row]:
    """All numbers of one simulated scan, with what is true of them."""
    return {**needle_scene(seed), **wire_scene(seed), **nwire_scene(seed), **point_scene(seed)}


def rms(errors: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(errors**2)))


def row(quantity: Quantity, truth: float) -> Row:
    """What the table needs."""
    return quantity.low_mm, quantity.high_mm, truth


def needle_scene(seed: int) -> dict[str, Row]:
    """The paper's protocol: 50 sightings fitted, 40 held out, 3000 as the truth."""
    simulated = simulate_observations(2, FITTED + HELD_OUT + ENDLESS, seed=seed)
    parts = np.split(np.arange(FITTED + HELD_OUT + ENDLESS), [FITTED, FITTED + HELD_OUT])
    rows, unseen, endless = (simulated.observations.select(part) for part in parts)
    found = sc.calibrate(rows, image_size_px=IMAGE)
    rows = rows.select(found.inlier)
    folds = [
        line_distances(refitted(found, rows, rows.frame != frame), endless)
        for frame in np.unique(rows.frame)[::5]
    ]
    repeated = repeatability(found, rows)
    missed = (
        found.probe_from_image @ repeated.places_px - simulated.probe_from_image @ repeated.places_px
    ) ** 2
    again = sc.calibrate(unseen, image_size_px=IMAGE)
    return {
        "held-out": row(held_out(found, unseen), rms(line_distances(found.probe_from_image, endless))),
        "leave-one-frame-out": row(leave_one_frame_out(found, rows), rms(np.concatenate(folds))),
        # The spread over repeats is the same for every seed: these are squared errors, to be averaged.
        "repeatability-corners": row(repeated.corners, float(missed[:-1].sum(axis=1).mean())),
        "repeatability-centre": row(repeated.centre, float(missed[-1].sum())),
        "compare": (compare(found, again).p_value, np.inf, 0.05),
    }


def wires(rng: np.random.Generator, truth: AxisScaled, targets: int, frames: int) -> sc.Observations:
    """Wires that are off by an offset each, at random tilts: 0.3 mm a row, 0.4 mm a wire."""
    count = targets * frames
    frame, target = np.repeat(np.arange(frames), targets), np.tile(np.arange(targets), frames)
    points = rng.uniform(0, 500, (count, 2))
    middle = truth @ points + 0.4 * rng.normal(size=(targets, 3))[target] + 0.3 * rng.normal(size=(count, 3))
    along = 50 * rng.normal(size=(count, 3))
    return sc.Observations(
        points, np.stack([middle - along, middle + along], axis=1), frame=frame, target=target.astype(str)
    )


def wire_scene(seed: int) -> dict[str, Row]:
    """Twelve wires of the true errors above; the truth from calibrations that miss a wire, on 3000 new wires."""
    rng = np.random.default_rng(seed)
    truth = simulate_observations(2, 4, seed=seed).probe_from_image
    rows, endless = wires(rng, truth, 12, 20), wires(rng, truth, ENDLESS, 1)
    found = sc.calibrate(rows, image_size_px=IMAGE)
    rows = rows.select(found.inlier)
    folds = [
        line_distances(refitted(found, rows, rows.target != name), endless) for name in np.unique(rows.target)
    ]
    return {"leave-one-target-out": row(leave_one_target_out(found, rows), rms(np.concatenate(folds)))}


def nwire_table(rng: np.random.Generator, truth: AxisScaled, frames: int) -> sc.Observations:
    """Three Ns, 10 mm apart in depth, cut by image planes with tilts of some 10 degrees; noise 1 px."""
    wires_mm = np.array(
        [
            [[x, -20.0, depth], [x + slant, 20.0, depth]]
            for depth in (20.0, 40.0, 60.0)
            for x, slant in ((-20.0, 0.0), (-15.0, 30.0), (20.0, 0.0))
        ]
    )
    drawn = rng.normal(size=(frames, 24))
    turned = Rotation.from_rotvec(0.15 * drawn[:, :3]).as_matrix()
    # In the image's frame, mm: (x, out of plane, depth).
    seen = (
        np.einsum("fij,wpj->fwpi", turned, wires_mm)
        - 3 * np.einsum("fij,fj->fi", turned, drawn[:, 3:6])[:, None, None]
    )
    start, end = seen[:, :, 0], seen[:, :, 1]
    share = start[..., 1] / (start[..., 1] - end[..., 1])
    cut = start + share[..., None] * (end - start)
    middle = np.array([250.0, 0, 0])
    pixels = cut[..., [0, 2]] / truth.scales[0] + middle[:2] + drawn[:, 6:].reshape(frames, 9, 2)
    volume = seen[..., [0, 2, 1]] * [1, 1, -1] / truth.scales[0] + middle
    return sc.Observations(
        pixels.reshape(-1, 2),
        (truth @ volume.reshape(-1, 3)).reshape(-1, 2, 3),
        frame=np.repeat(np.arange(frames), 9),
        target=np.tile(list("abcdefghi"), frames),
    )


def nwire_scene(seed: int) -> dict[str, Row]:
    """PLUS's trimmed mean over 40 frames, and over 1000 for the same calibration."""
    rng = np.random.default_rng(seed)
    truth = simulate_observations(2, 4, seed=seed).probe_from_image
    off = truth.retract(rng.normal(size=7) * [0.005, 0.005, 0.005, 0.3, 0.3, 0.3, 0.003])
    measured = nwire_error(off, nwire_table(rng, truth, 40), NWIRES)
    return {"plus-nwire": row(measured, nwire_error(off, nwire_table(rng, truth, 1000), NWIRES).value_mm)}


def points(rng: np.random.Generator, truth: AxisScaled, tip: np.ndarray, count: int) -> PointSightings:
    """One cross-wire from many poses; noise 1 px in the image, 0.3 mm and 0.2 deg in the pose."""
    pixels = rng.uniform(0, 500, (count, 2))
    rotations = Rotation.random(count, random_state=rng)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = rotations.as_matrix()
    poses[:, :3, 3] = -rotations.apply(truth @ pixels) + 0.3 * rng.normal(size=(count, 3))
    noise = Rotation.from_rotvec(rng.normal(scale=np.radians(0.2), size=(count, 3)))
    poses[:, :3, :3] = (noise * rotations).as_matrix()
    return PointSightings(
        pixels + rng.normal(size=pixels.shape), points_mm=np.tile(tip, (count, 1)), tracker_from_probe=poses
    )


def point_scene(seed: int) -> dict[str, Row]:
    """A cross-wire whose place the tip gives to 0.5 mm, 30 poses; 3000 for the truth."""
    rng = np.random.default_rng(seed)
    truth = simulate_observations(2, 4, seed=seed).probe_from_image
    off = truth.retract(rng.normal(size=7) * [0.005, 0.005, 0.005, 0.3, 0.3, 0.3, 0.003])
    tip = rng.normal(scale=0.5, size=3)
    few, many = points(rng, truth, tip, 30), points(rng, truth, tip, ENDLESS)
    return {
        "pra-crosswire": row(reconstruction_accuracy(off, few), reconstruction_accuracy(off, many).value_mm),
        "crosswire-spread": row(fixed_point_spread(off, few), fixed_point_spread(off, many).value_mm),
    }


def coverage(scenes: int, workers: int) -> None:
    """The share of intervals that hold the true value, by number."""
    with ProcessPoolExecutor(workers) as pool:
        rows = list(pool.map(scene, range(scenes), chunksize=20))
    for code in rows[0]:
        low, high, truth = np.array([r[code] for r in rows]).T
        if code.startswith("repeatability"):
            truth = np.full(scenes, np.sqrt(truth.mean()))
        held = np.mean((low <= truth) & (truth <= high))
        if code == "compare":
            print(f"{'two equal calibrations said to differ (p < 0.05)':60s} {np.mean(low < truth):.1%}")
            continue
        print(
            f"{'interval holds the truth: ' + code:60s} {held:.1%} (below {np.mean(truth < low):.1%})",
            flush=True,
        )


def plus_error(data: Path, name: str) -> None:
    """PLUS's error for PLUS's own matrices against what PLUS reported, and ours."""
    reference = json.loads((data / "observations" / f"{name}.reference.json").read_text())
    rows = sc.read_observations(data / "observations" / f"{name}.csv")
    fitted = sc.calibrate(rows, fit_split="calibration").probe_from_image

    def value(transform: AxisScaled, split: str) -> float:
        return nwire_error(transform, rows.select_split(split), reference["nwires"]).value_mm

    def label(one: dict[str, str], split: str) -> str:
        return f"{name}, {one['method']}, {split}"

    for one in reference["reference_calibrations"]:
        matrix = np.array(one["image_to_probe"])
        plus = AxisScaled(matrix[:3, :3], matrix[:3, 3], np.ones(3))
        for split in ("calibration", "validation"):
            reported = one["reported"][f"{split.capitalize()}MeanMm"]
            print(f"{label(one, split):76s} {value(plus, split):.5f} (PLUS reports {reported})")
    print(f"{name + ', sonocal, validation':76s} {value(fitted, 'validation'):.4f}", flush=True)


def report(data: Path) -> None:
    """Time and size of the report of the largest sets."""
    from sonocal.report import report_html

    for name in ("depth15_polaris", "trus_3nwires"):
        rows = sc.read_observations(data / "observations" / f"{name}.csv")
        found = sc.calibrate(rows, fit_split="calibration", test_split="validation")
        started = time.perf_counter(), time.process_time()
        numbers = validate(found, rows)
        validated = time.perf_counter(), time.process_time()
        page = report_html(found, rows, numbers)
        done = time.perf_counter(), time.process_time()
        for what, start, end in (("validate", started, validated), ("report", validated, done)):
            print(
                f"{f'{what}, {name}':60s} {end[0] - start[0]:.2f} s ({end[1] - start[1]:.2f} s of processor)"
            )
        print(f"{f'size of the report, {name}':60s} {len(page) / 1e6:.2f} MB", flush=True)


def crosswire(data: Path) -> None:
    """Calibration from a real fixed cross-wire alone: its residual, and the spread as validation reports it."""
    poses = np.tile(np.eye(4), (54, 1, 1))
    poses[:, :3] = np.loadtxt(data / "pivot" / "crosswire_probe_poses.txt").reshape(-1, 3, 4)
    pixels = np.loadtxt(data / "pivot" / "crosswire_points_px.txt")
    sightings = PointSightings(pixels, tracker_from_probe=poses)
    found = fit_crosswire(sightings)
    spread = fixed_point_spread(found.probe_from_image, sightings)
    print(f"{'cross-wire, 54 poses: linear fit, free image axes, rms':60s} {found.linear_rms_mm:.2f} mm")
    print(f"{'cross-wire, 54 poses: similarity, rms':60s} {rms(found.residuals_mm):.2f} mm")
    print(
        f"{'cross-wire, 54 poses: spread':60s} {spread.value_mm:.2f} mm ({spread.low_mm:.2f} to {spread.high_mm:.2f})"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=2000)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    if options.data.exists():
        for name in ("depth15_polaris", "fcal12_ascension", "trus_3nwires"):
            plus_error(options.data, name)
        report(options.data)
        crosswire(options.data)
    coverage(options.scenes, options.workers)


if __name__ == "__main__":
    main()
