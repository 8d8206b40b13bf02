"""What walls, cross-wires and wires are worth beside a needle, from images to an answer; and what odd tanks are told.

python -m benchmarks.walls [--seeds 20] [--first 1000] [--only scenes slices detection odd] [--write docs/detection.md]

Images are those of `simulators.tank_images`, which shares nothing with the detector nor with sonocal's simulation: 30 a
scan, of 300 x 300 px and 0.36 mm, a tenth of them without what is scanned, two other bright things in each; markers are
tracked to 0.2 mm and 0.0015 rad. The place of what is fixed in the room is known. Errors are of points spread over what
the fan shows. Settings were found on seeds below 100.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import sonocal as sc
from benchmarks.pages import tell
from benchmarks.simulators.tank_images import Tank, Wall, tank_image
from benchmarks.simulators.tank_probe import Probe
from benchmarks.simulators.tank_scans import Scan, tank_scan
from sonocal.detection import WallDetector, find_mask
from sonocal.recording import ArrayFrames
from sonocal.registration.uncertainty import point_covariance, radius_95
from sonocal.sweep import calibrate_recording

SCENES = {
    "needle": "needle, moved about",
    "wires": "nine wires",
    "cross-wire": "one cross-wire",
    "cross-wires": "four cross-wires",
    "wall": "one wall",
    "walls": "four walls",
}
ODD: dict[str, dict[str, Any]] = {
    "eight times the gain": {"tank": Tank(gain=8.0)},
    "an eighth of the gain": {"tank": Tank(gain=0.125)},
    "the second face brighter than the first": {"tank": Tank(behind=1.6)},
    "a thick slice (4 mm)": {"tank": Tank(slice_mm=4.0)},
    "a third of the wall in view": {"part": (0.35, 0.65)},
    "held aslant, so that a mirror fades": {"tilt": 0.5, "tank": Tank(mirror=0.1)},
    "a needle before the wall": {"needle_in_front": True, "tank": Tank(shadow=0.3)},
    "another wall 12 mm above it": {"other_mm": 12.0},
    "no wall in any image": {"hidden": 1.0},
    "no wall in half of the images": {"hidden": 0.5},
}
PICTURES: dict[str, tuple[Tank, Probe]] = {
    "in water": (Tank(), Probe()),
    "linear array": (Tank(), Probe(radius_mm=0.0)),
    "speckle six times as strong": (Tank(speckle=0.03), Probe()),
    "eight times the gain": (Tank(gain=8.0), Probe()),
    "a slice of 4 mm": (Tank(slice_mm=4.0), Probe()),
    "no wall": (Tank(rough=0.0, behind=0.0, gain=0.5), Probe()),
}
SLICES_MM = (0.6, 1.2, 2.4)
"""Standard deviations of a slice's thickness."""
WIRES = {"count": 15}
"""How nine wires are looked for."""
FAR_OFF = 3.0
"""Times the predicted error: an answer that is so far off without a warning is confidently wrong."""


class Trial(NamedTuple):
    """Errors at places over the image, mm, with what was predicted there, if it was; what was warned of; seconds."""

    errors: np.ndarray
    predicted: np.ndarray | None
    warned: bool
    seconds: float

    @property
    def rms(self) -> float:
        """Over the image."""
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def confidently_wrong(self) -> bool:
        """Whether it is far off what it says, and nothing is said."""
        far = self.predicted is not None and bool(np.any(self.errors > FAR_OFF * self.predicted))
        return far and not self.warned


def trial(scan: Scan, probe: Probe, **options: Any) -> Trial | None:
    """One recording to a calibration; None where it is refused."""
    begun = time.process_time()
    try:
        found = calibrate_recording(scan.recording, scan.targets, **options).calibration
    except sc.SonocalError:
        return None
    seconds, places = time.process_time() - begun, _places(probe)
    errors = np.linalg.norm(found.probe_from_image @ places - scan.truth @ places, axis=1)
    predicted = None
    if found.covariance is not None:
        covariances = point_covariance(found.probe_from_image, found.covariance, places[:, :2])
        predicted = radius_95(covariances, found.noise.freedom)
    return Trial(errors, predicted, bool(found.warnings), seconds)


def _places(probe: Probe) -> np.ndarray:
    """(N, 3), px: spread over where beams run."""
    ticks = np.linspace(0, probe.side_px - 1, 9)
    grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    beam, far = probe.beam_of(grid * probe.mm_per_px)
    seen = grid[(beam >= 0) & (beam <= probe.beams - 1) & (far >= 0)]
    return np.column_stack([seen, np.zeros(len(seen))])


def scenes(seeds: Iterable[int]) -> Iterator[tuple[str, str]]:
    """Of calibrations: what is scanned by turns."""
    seeds, probe = list(seeds), Probe()
    yield (
        "walls",
        f"| what is scanned, {len(seeds)} seeds | rms error, mm | worst seed | predicted (95 %), mm | within it | "
        "refused | time, s |",
    )
    yield "walls", "|---|---|---|---|---|---|---|"
    for scene, name in SCENES.items():
        options = WIRES if scene == "wires" else {}
        trials = [trial(tank_scan(seed, scene), probe, **options) for seed in seeds]
        yield "walls", _of_scene(name, [one for one in trials if one is not None], len(seeds))


def slices(seeds: Iterable[int]) -> Iterator[tuple[str, str]]:
    """Of calibrations by nine wires: slices of several thicknesses by turns."""
    seeds, probe = list(seeds), Probe()
    yield (
        "slices",
        f"| nine wires, {len(seeds)} seeds; the slice's | rms error, mm | worst seed | predicted (95 %), mm | within "
        "it | refused | time, s |",
    )
    yield "slices", "|---|---|---|---|---|---|---|"
    for slice_mm in SLICES_MM:
        tank = Tank(slice_mm=slice_mm)
        trials = [trial(tank_scan(seed, "wires", tank=tank), probe, **WIRES) for seed in seeds]
        name = f"standard deviation is {slice_mm:g} mm"
        yield "slices", _of_scene(name, [one for one in trials if one is not None], len(seeds))


def _of_scene(name: str, there: list[Trial], count: int) -> str:
    if not there:
        return f"| {name} | - | - | - | - | {count} | - |"
    rms = np.sqrt(np.mean([one.rms**2 for one in there]))
    told = [(one.errors, one.predicted) for one in there if one.predicted is not None]
    says = "not predicted | -"
    if told:
        within = np.mean([np.mean(errors <= predicted) for errors, predicted in told])
        usual = np.sqrt(np.mean([np.mean(predicted**2) for _, predicted in told]))
        says = f"{usual:.2f} | {100 * within:.0f} %"
    seconds = np.median([one.seconds for one in there])
    worst = max(one.rms for one in there)
    return f"| {name} | {rms:.2f} | {worst:.2f} | {says} | {count - len(there)} | {seconds:.1f} |"


def odd(seeds: Iterable[int]) -> Iterator[tuple[str, str]]:
    """Of scans of four walls in which something is not as it should be."""
    seeds, probe = list(seeds), Probe()
    yield (
        "odd-walls",
        f"| four walls, {len(seeds)} seeds | refused | answered with a warning | without | rms error, mm | predicted "
        "(95 %), mm | confidently wrong |",
    )
    yield "odd-walls", "|---|---|---|---|---|---|---|"
    for name, how in ({"as it should be": {}} | ODD).items():
        trials = [trial(tank_scan(seed, "walls", **how), probe) for seed in seeds]
        there = [one for one in trials if one is not None]
        warned, wrong = sum(one.warned for one in there), sum(one.confidently_wrong for one in there)
        rms, told = "-", "-"
        if there:
            rms = f"{np.sqrt(np.mean([one.rms**2 for one in there])):.2f}"
            means = [np.mean(one.predicted**2) for one in there if one.predicted is not None]
            told = f"{np.sqrt(np.mean(means)):.2f}" if means else "not predicted"
        counts = f"{len(seeds) - len(there)} | {warned} | {len(there) - warned}"
        yield "odd-walls", f"| {name} | {counts} | {rms} | {told} | {wrong} |"


def detection(seeds: Iterable[int]) -> Iterator[tuple[str, str]]:
    """Of single images: where the best candidate lies."""
    seeds = list(seeds)
    yield (
        "wall-images",
        f"| {len(seeds)} images each | found first | others before it | rms error, px | mean, px | normalised errors' "
        "mean square |",
    )
    yield "wall-images", "|---|---|---|---|---|---|"
    for name, (tank, probe) in PICTURES.items():
        yield "wall-images", f"| {name} | {_detected(tank, probe, seeds, shown=name != 'no wall')} |"


def _detected(tank: Tank, probe: Probe, seeds: list[int], *, shown: bool) -> str:
    drawn = [_picture(tank, probe, seed, shown=shown) for seed in seeds]
    stack = np.array([image for image, _, _ in drawn])
    detector = WallDetector(find_mask(ArrayFrames(stack), 2, "pictures"))
    off, normalised, others = [], [], 0
    for image, through, normal in drawn:
        walls, _ = detector.detect(image)
        if not walls:
            continue
        away = (walls[0].points_px - through) @ normal
        if not shown or np.abs(away).max() > 5:
            others += 1
            continue
        off.append(away)
        variance = np.einsum("i,pij,j->p", normal, walls[0].covariance_px2, normal)
        normalised.append(away / np.sqrt(variance))
    if not off:
        return f"{len(off)} | {others} | - | - | -"
    rms, mean = np.sqrt(np.mean(np.square(off))), np.mean(off)
    return f"{len(off)} | {others} | {rms:.2f} | {mean:+.2f} | {np.mean(np.square(normalised)):.2f}"


def _picture(
    tank: Tank, probe: Probe, seed: int, *, shown: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An image, a point of its wall, px, and the wall's normal in the image, away from the probe."""
    rng = np.random.default_rng([seed, 11])
    tilt, lean, depth = 0.25 * rng.normal(), 0.12 * rng.normal(), rng.uniform(0.3, 0.85) * probe.side_mm
    normal = np.array([np.sin(tilt) * np.cos(lean), np.cos(tilt) * np.cos(lean), np.sin(lean)])
    through = np.array([0.5 * probe.side_mm, depth])
    wall = Wall(normal, float(normal[:2] @ through))
    image = tank_image(rng, probe, tank, (wall,) if shown else ())
    return image, through / probe.mm_per_px, normal[:2] / np.linalg.norm(normal[:2])


PARTS = {"scenes": scenes, "slices": slices, "detection": detection, "odd": odd}


def main() -> None:
    """Print the tables, and write them into a page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--write", type=Path, help="into this page, between its marks")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    tell((line for part in given.only for line in PARTS[part](seeds)), given.write)


if __name__ == "__main__":
    main()
