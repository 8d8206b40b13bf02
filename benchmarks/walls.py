"""What a needle, wires, cross-wires and walls are worth, from images to a calibration, at the same number of images.

python -m benchmarks.walls [--seeds 10] [--frames 60 120] [--rows needle walls ...] [--write docs/detection.md]

Images are simulated in water, with other bright things in view, a tenth of them without a target; noise of 0.5 px in
the image, and of 0.3 mm of the probe's marker about the image's middle or of the needle's ends. The place of what is
fixed in the room is known. Errors are of points spread over the image. A second table is of detection alone, in
pictures of `simulators.wall_pictures`, which shares nothing with the detector nor with sonocal's simulation.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import sonocal as sc
from benchmarks.simulators.wall_pictures import wall_picture
from sonocal.detection import WallDetector
from sonocal.registration.uncertainty import point_covariance, radius_95
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.target_sweep import TargetOptions, scene_of, simulate_targets
from sonocal.simulation.ultrasound import BATH
from sonocal.sweep import calibrate_recording

BEGIN, END = "<!-- walls: written by benchmarks/walls.py -->", "<!-- end of walls -->"
ROWS = {
    "needle": "needle, moved about",
    "wires": "nine wires",
    "cross-wire": "one cross-wire",
    "cross-wires": "four cross-wires",
    "wall": "one wall: the floor",
    "walls": "the floor and four walls",
}
SIGMA_PX, SIGMA_MM, HIDDEN = 0.5, 0.3, 0.1
SIDE_PX = 500.0
PICTURES = 60


class Trial(NamedTuple):
    """Errors at places over the image, mm, with what was predicted there, if it was; and the share of images used."""

    errors: np.ndarray
    predicted: np.ndarray | None
    used: float


def trial(row: str, frames: int, seed: int) -> Trial | None:
    """One recording to a calibration; None where it is refused."""
    if row == "needle":
        how = SweepOptions(
            frames=frames, rate_hz=8.0, sigma_px=SIGMA_PX, sigma_mm=SIGMA_MM, hidden_share=HIDDEN, seed=seed
        )
        needle = simulate_sweep(look=BATH, options=how)
        recording, targets, truth = needle.recording, needle.lines, needle.truth.probe_from_image
    else:
        options = TargetOptions(frames, sigma_px=SIGMA_PX, sigma_mm=SIGMA_MM, hidden_share=HIDDEN, seed=seed)
        seen = simulate_targets(scene_of(row), look=BATH, options=options)
        recording, targets, truth = seen.recording, seen.targets, seen.truth.probe_from_image
    try:
        found = calibrate_recording(recording, targets, **({"count": 15} if row == "wires" else {}))
    except sc.SonocalError:
        return None
    calibration, places = found.calibration, _places()
    errors = np.linalg.norm(calibration.probe_from_image @ places - truth @ places, axis=1)
    predicted = None
    if calibration.covariance is not None:
        about = calibration.probe_from_image, calibration.covariance, places[:, :2]
        predicted = radius_95(point_covariance(*about), calibration.noise.freedom)
    return Trial(errors, predicted, found.used / found.sightings)


def _places() -> np.ndarray:
    grid = np.stack(np.meshgrid(*[np.linspace(0, SIDE_PX - 1, 6)] * 2), axis=-1).reshape(-1, 2)
    return np.column_stack([grid, np.zeros(len(grid))])


def of_row(row: str, frames: int, seeds: int) -> str:
    """A line of the table."""
    trials = [trial(row, frames, seed) for seed in range(seeds)]
    there = [one for one in trials if one is not None]
    if not there:
        return f"| {ROWS[row]} | {frames} | - | - | - | - | {seeds} |"
    errors = np.array([one.errors for one in there])
    predicted = [one.predicted for one in there if one.predicted is not None]
    worst = np.sqrt(np.mean(errors**2, axis=1)).max()
    told = "not predicted | -"
    if predicted:
        right = np.mean([np.mean(one.errors <= one.predicted) for one in there if one.predicted is not None])
        told = f"{np.sqrt(np.mean(np.square(predicted))):.2f} | {100 * right:.0f} %"
    rms = float(np.sqrt(np.mean(errors**2)))
    return f"| {ROWS[row]} | {frames} | {rms:.2f} | {worst:.2f} | {told} | {seeds - len(there)} |"


def table(rows: list[str], frames: list[int], seeds: int) -> Iterator[str]:
    """Of calibrations."""
    yield (
        f"| what is scanned, {seeds} seeds | images | rms error, mm | worst seed | predicted (95 %), mm | within it "
        "| refused |"
    )
    yield "|---|---|---|---|---|---|---|"
    for row in rows:
        for count in frames:
            line = of_row(row, count, seeds)
            print(line, flush=True)
            yield line


def pictures() -> Iterator[str]:
    """Of detection alone."""
    yield f"| {PICTURES} pictures each | found first | rms error, px | mean, px | normalised errors' mean square |"
    yield "|---|---|---|---|---|"
    for name, how in {
        "in water": {},
        "in speckle at a tenth of the wall": {"speckle": 0.1},
        "six times the gain": {"gain": 6.0},
        "a slice of twice the thickness": {"slice_px": 10.0},
    }.items():
        yield f"| {name} | {_detected(how)} |"


def _detected(how: dict[str, float]) -> str:
    errors, normalised = [], []
    for seed in range(PICTURES):
        rng = np.random.default_rng([11, seed])
        tilt, lean, depth = rng.normal(scale=0.3), rng.normal(scale=0.12), rng.uniform(110, 290)
        image = wall_picture(rng, tilt=tilt, lean=lean, depth_px=depth, **how)
        walls, _ = WallDetector(np.ones(image.shape, dtype=bool)).detect(image)
        if not walls:
            continue
        points = walls[0].points_px
        middle = 0.5 * (image.shape[1] - 1)
        off = (points[:, 1] - depth - np.tan(tilt) * (points[:, 0] - middle)) * np.cos(tilt)
        if np.abs(off).max() < 5:
            errors.append(off)
            normalised.append(off / np.sqrt(np.trace(walls[0].covariance_px2, axis1=1, axis2=2)))
    off, square = np.array(errors), np.mean(np.square(normalised))
    return f"{len(off)} | {np.sqrt(np.mean(off**2)):.2f} | {off.mean():+.2f} | {square:.2f}"


def write(path: Path, text: str) -> None:
    """The tables into a page, between its marks."""
    before, rest = path.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    path.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}", encoding="utf-8")


def main() -> None:
    """Print the tables, and write them into a page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--frames", type=int, nargs="+", default=[60, 120])
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=list(ROWS))
    parser.add_argument("--write", type=Path, help="into this page, between its marks")
    given = parser.parse_args()
    text = "\n".join([*table(given.rows, given.frames, given.seeds), "", *pictures()])
    print(text)
    if given.write:
        write(given.write, text)


if __name__ == "__main__":
    main()
