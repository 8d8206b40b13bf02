"""From images of nine wires that nobody names to a calibration, with default options; and what text does to it.

Frames of PLUS's fCal_Test_Calibration_3NWires are drawn at random, and calibrated by images and poses alone. What comes
out is compared with the calibration of the points that PLUS segmented and named, on all frames. For text, letters that
flicker as compressed video does are drawn over the images, as a frame grabber has them.

python -m benchmarks.label_images [--rows draws all text] [--draws 40]
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

import sonocal as sc
from sonocal.detection import DetectionOptions, detect, find_mask
from sonocal.recording import Recording
from sonocal.recording.formats import read_recording
from sonocal.recording.frames import ArrayFrames
from sonocal.targets import Line, read_lines

DATA = Path(__file__).parents[2] / "shared" / "data"
NAME = "fCal_Test_Calibration_3NWires"
DEVICES = "PlusDeviceSet_fCal_Sim_SpatialCalibration_1.2.xml"
# A found point is PLUS's within that; an answer of five frames is right within that of all frames' one.
NEAR_PX = 3.0
RIGHT_MM = 3.0
# The places that both calibrations are compared at are those where wires are seen.
EDGE = (0.02, 0.98)


def places(table: sc.Observations) -> np.ndarray:
    """Corners of the box that holds the wires' points, and its middle, px."""
    low, high = np.quantile(table.points_px[:, :2], EDGE, axis=0)
    corners = np.array([[u, v] for u in (low[0], high[0]) for v in (low[1], high[1])])
    return np.vstack([corners, corners.mean(axis=0)])


def labelled() -> tuple[sc.Observations, np.ndarray, np.ndarray]:
    """PLUS's table, where to compare, and where its calibration puts that, mm."""
    table = sc.read_observations(DATA / "observations" / "fcal12_ascension.csv").select_split("calibration")
    at = places(table)
    return table, at, sc.calibrate(table).probe_from_image @ at


def off_mm(found: sc.Calibration, at: np.ndarray, there: np.ndarray) -> float:
    """The farthest that a calibration is from the labelled one."""
    return float(np.linalg.norm(found.probe_from_image @ at - there, axis=1).max())


def draws(recording: Recording, lines: list[Line], options: dict, count: int, frames: int) -> None:
    """Calibrations of a few frames drawn at random."""
    _, at, there = labelled()
    outcomes: Counter[str] = Counter()
    off, seconds = [], []
    for seed in range(count):
        chosen = np.sort(np.random.default_rng(seed).choice(len(recording.frames), frames, replace=False))
        begin = time.process_time()
        try:
            found = sc.calibrate_recording(recording.select(chosen), lines, **options)
        except sc.SonocalError as error:
            outcomes[type(error).__name__] += 1
            print(f"  draw {seed}: {str(error)[:160]}")
            continue
        finally:
            seconds.append(time.process_time() - begin)
        off.append(off_mm(found.calibration, at, there))
        codes = [
            one.code
            for one in found.calibration.diagnostics
            if one.code in ("labels-ambiguous", "labels-unfinished")
        ]
        outcomes[codes[0] if codes else "right" if off[-1] <= RIGHT_MM else "WRONG"] += 1
    spread = np.quantile(off, [0.5, 0.95, 1]).round(2) if off else "none"
    print(
        f"{frames} frames, {count} draws: {dict(outcomes)}; off by {spread} mm (median, 95 %, most); "
        f"{np.median(seconds):.1f} s (median), {max(seconds):.1f} s (most)"
    )


def everything(recording: Recording, lines: list[Line], options: dict) -> None:
    """A calibration of all frames."""
    _, at, there = labelled()
    begin = time.process_time()
    found = sc.calibrate_recording(recording, lines, **options)
    seconds = time.process_time() - begin
    print(
        f"all {len(recording.frames)} frames: {off_mm(found.calibration, at, there):.2f} mm at most from the labelled "
        f"one, {found.used} of {found.sightings} sightings, {seconds:.1f} s"
    )


def letters(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Grey levels of lines of letters along two sides of an image, 0 where there is none."""
    from scipy.ndimage import gaussian_filter

    drawn = np.zeros(shape)
    for row in range(20, shape[0] - 20, 24):
        for column in (*range(10, 120, 12), *range(shape[1] - 130, shape[1] - 20, 12)):
            glyph = np.kron(rng.random((7, 5)) < 0.45, np.ones((2, 2)))
            drawn[row : row + 14, column : column + 10] = glyph * rng.uniform(150, 255)
    return np.asarray(gaussian_filter(drawn, 0.6))


def grabbed(recording: Recording, seed: int = 0) -> tuple[Recording, np.ndarray]:
    """The images with letters that flicker by a few per cent, as compressed video does; and where letters are."""
    rng = np.random.default_rng(seed)
    text = letters(recording.frames[0].shape[:2], rng)
    images = []
    for image in recording.frames:
        flicker = 1 + rng.normal(scale=0.03) + rng.normal(scale=0.02, size=text.shape)
        images.append(np.clip(np.maximum(image, text * flicker), 0, 255).astype(np.uint8))
    return replace(recording, frames=ArrayFrames(np.array(images))), text > 60


def found_share(recording: Recording, table: sc.Observations, count: int) -> float:
    """Of the points that PLUS segmented, the share with a candidate near."""
    found = detect(recording, DetectionOptions(count=count, centre="mass"))
    near = [
        np.linalg.norm(found.points_px[found.frame == frame, 0] - point[:2], axis=1).min(initial=np.inf)
        <= NEAR_PX
        for frame, point in zip(table.frame, table.points_px, strict=True)
    ]
    return float(np.mean(near))


def text(recording: Recording) -> None:
    """Points found among letters; and wires that stand still, which no mask may hide."""
    table, _, _ = labelled()
    drawn, where = grabbed(recording)
    mask = find_mask(drawn.frames)
    # Where letters were drawn over wires nothing can be seen.
    free = table.select(np.flatnonzero(~where[tuple(table.points_px[:, 1::-1].round().astype(int).T)]))
    print(f"letters masked: {100 * np.mean(~mask[where]):.1f} %")
    plain = find_mask(recording.frames)[tuple(table.points_px[:, 1::-1].round().astype(int).T)]
    print(f"wires of the recording hidden: {100 * np.mean(~plain):.1f} % of {len(table)}")
    for count in (9, 12, 15):
        plainly, among = found_share(recording, table, count), found_share(drawn, free, count)
        print(
            f"{count} candidates, points found within {NEAR_PX:.0f} px: {100 * plainly:.1f} % without letters, "
            f"{100 * among:.1f} % among them"
        )
    for name, images in still(recording, table).items():
        held = find_mask(images)
        first = table.points_px[table.frame == 0][:, 1::-1].round().astype(int)
        print(f"still wires hidden, {name}: {100 * np.mean(~held[tuple(first.T)]):.1f} % of {len(first)}")


def still(recording: Recording, table: sc.Observations) -> dict[str, ArrayFrames]:
    """Images of wires that stand still: one image again and again, with noise and gain that flickers."""
    rng, image = np.random.default_rng(0), recording.frames[0].astype(float)
    out = {}
    for name, noise, flicker in (
        ("noise of 3 levels", 3.0, 0.0),
        ("noise of 3 levels and gain by 5 %", 3.0, 0.05),
    ):
        frames = [
            image * (1 + flicker * rng.normal()) + noise * rng.normal(size=image.shape) for _ in range(24)
        ]
        out[name] = ArrayFrames(np.clip(frames, 0, 255).astype(np.uint8))
    return out


def main() -> None:
    """Print what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--rows", nargs="+", choices=("draws", "all", "text"), default=["draws", "all", "text"]
    )
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--frames", type=int, default=5)
    arguments = parser.parse_args()
    recording = read_recording(DATA / "recordings" / f"{NAME}.igs.mha")
    lines, fixed = read_lines(DATA / "recordings" / DEVICES)
    if "all" in arguments.rows:
        everything(recording, lines, {"fixed": fixed})
    if "text" in arguments.rows:
        text(recording)
    if "draws" in arguments.rows:
        draws(recording, lines, {"fixed": fixed}, arguments.draws, arguments.frames)


if __name__ == "__main__":
    main()
