"""How near to the least error a calibration comes when nobody knows where its target is, and whether it says so.

python -m benchmarks.places [--scenes 200] [--first-seed 0] [--exact] [--motions] [--known] [--write PAGE]

A probe sees one target over a tank (1 px, poses 0.3 mm and 0.2 degrees, tilts to 40 degrees; 0.2 mm/px). "error": root
mean square over the image; "over the bound": over that of Cramer and Rao in that scene, likewise; "found": scenes whose
error is below four times it; "covered": image corners within the 95 % stated; "target": likewise of where it was found.
Times are of a processor, the median scene's.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import fdtri

from benchmarks.pages import tell
from benchmarks.simulators.mixes import Array
from benchmarks.simulators.places import Kind, Noise, Sweep, image_points, sweep
from benchmarks.simulators.places_bound import least_error_mm
from sonocal.errors import DegenerateGeometryError, SonocalError
from sonocal.registration.uncertainty import point_covariance, radius_95
from sonocal.registration.unplaced import Placed, UnplacedTarget, register_unplaced

# Kind, frames, share of outliers, whether the target is held by a tracked tool, dimension of the image.
Case = tuple[Kind, int, float, bool, int]
CASES: tuple[Case, ...] = (
    ("point", 12, 0.0, False, 2),
    ("point", 20, 0.4, False, 2),
    ("point", 60, 0.0, False, 2),
    ("point", 60, 0.4, False, 2),
    ("line", 20, 0.0, False, 2),
    ("line", 20, 0.2, False, 2),
    ("line", 60, 0.0, False, 2),
    ("line", 60, 0.4, False, 2),
    ("line", 60, 0.0, True, 2),
    ("line", 20, 0.0, False, 3),
    ("plane", 60, 0.0, False, 2),
    ("plane", 60, 0.2, False, 2),
)
EXACT: tuple[tuple[Kind, int, int], ...] = (
    ("point", 4, 2),
    ("point", 12, 2),
    ("line", 6, 2),
    ("line", 12, 2),
    ("plane", 12, 2),
    ("plane", 20, 2),
    ("line", 6, 3),
)
KINDS_OF: tuple[Kind, ...] = ("point", "line", "plane")
MOTIONS = ("translation", "one-axis", "yaw", "about-target", "pivot", "small tilts")
EXACT_MM, FAR = 1e-6, 4.0


class Outcome(NamedTuple):
    """Of one scene: whether it was found, errors (mm), and whether the truth is within what was stated."""

    found: bool
    refused: bool
    error_mm: float
    least_mm: float
    covered: float
    place_covered: bool
    seconds: float


def registered(scene: Sweep, kind: Kind) -> Placed:
    """A scene, with its target's place unknown."""
    target = UnplacedTarget(kind, body=0 if scene.tracked else None)
    points = scene.points_px[:, : scene.dimension]
    return register_unplaced(points, scene.poses, [target], frame=scene.frame)


def outcome(kind: Kind, scene: Sweep) -> Outcome:
    """What came of a scene with noise."""
    least = least_error_mm(scene, Noise())[0]
    begin = time.process_time()
    try:
        answer = registered(scene, kind)
    except SonocalError as error:
        seconds = time.process_time() - begin
        refused = isinstance(error, DegenerateGeometryError)
        return Outcome(False, refused, np.nan, least, np.nan, False, seconds)
    seconds = time.process_time() - begin
    off = off_mm(answer, scene, image_points(scene.dimension))
    corners = image_points(scene.dimension)[[0, 4, 20, 24]]
    covariance = point_covariance(answer.marker_from_source, answer.covariance, corners)
    covered = off_mm(answer, scene, corners) <= radius_95(covariance, answer.freedom)
    error = float(np.sqrt(np.mean(off**2)))
    return Outcome(
        error < FAR * least, False, error, least, float(covered.mean()), place_within(answer, scene), seconds
    )


def off_mm(answer: Placed, scene: Sweep, points: Array) -> Array:
    """(P,): how far some points of the image are off."""
    there = points @ scene.truth[:3, :3].T + scene.truth[:3, 3]
    return np.linalg.norm(answer.marker_from_source @ points - there, axis=1)


def place_within(answer: Placed, scene: Sweep) -> bool:
    """Whether the true place is in the 95 % region of the one found."""
    place = answer.places[0]
    assert place.covariance is not None
    spans = len(scene.place)
    normals, along = place.axes[:, : 4 - spans], place.axes[:, 4 - spans :]
    away = scene.place[0] - place.middle_mm
    turns = np.zeros((4 - spans, spans - 1))
    if spans > 1:
        frame = np.linalg.svd(scene.place[1:] - scene.place[0])[2]
        true_along = frame[: spans - 1].T
        turns = normals.T @ true_along @ np.linalg.inv(along.T @ true_along)
    shift = normals.T @ away - turns @ (along.T @ away)
    off = np.concatenate([shift, -turns.ravel()])
    square = off @ np.linalg.solve(place.covariance, off) / len(off)
    return bool(square <= fdtri(len(off), max(answer.freedom, 1), 0.95))


def row_of(case: Case, seeds: range) -> str:
    """A line of the table."""
    kind, frames, wrong, tracked, dimension = case
    scenes = (
        sweep(kind, frames, seed, Noise(), wrong=wrong, tracked=tracked, dimension=dimension)
        for seed in seeds
    )
    all_of = [outcome(kind, scene) for scene in scenes]
    sound = [one for one in all_of if one.found]
    error, least = (np.array([getattr(one, name) for one in sound]) for name in ("error_mm", "least_mm"))
    return (
        f"| {kind}{', in a tracked tool' if tracked else ''}{', 3D' if dimension == 3 else ''} | {frames} "
        f"| {100 * wrong:.0f} % | {np.sqrt(np.mean(error**2)):.2f} | {np.sqrt(np.mean((error / least) ** 2)):.2f} "
        f"| {len(sound)} of {len(all_of)} | {100 * np.mean([one.covered for one in sound]):.0f} % "
        f"| {100 * np.mean([one.place_covered for one in sound]):.0f} % "
        f"| {1e3 * np.median([one.seconds for one in all_of]):.0f} ms |"
    )


def table(seeds: range) -> Iterator[str]:
    """Of scenes with noise, line by line."""
    yield "| target | frames | outliers | error, mm | over the bound | found | covered | target | time |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for case in CASES:
        yield row_of(case, seeds)


def exact_table(seeds: range) -> Iterator[str]:
    """Of scenes without noise, line by line."""
    yield "| target | frames | image | exact to 1e-6 mm |"
    yield "|---|---|---|---|"
    for kind, frames, dimension in EXACT:
        found = 0
        for seed in seeds:
            scene = sweep(kind, frames, seed, dimension=dimension)
            try:
                target = [UnplacedTarget(kind)]
                points = scene.points_px[:, :dimension]
                answer = register_unplaced(points, scene.poses, target, frame=scene.frame, trusted=True)
            except SonocalError:
                continue
            found += bool(off_mm(answer, scene, image_points(dimension)).max() < EXACT_MM)
        yield f"| {kind} | {frames} | {dimension}D | {found} of {len(seeds)} |"


def motion_table(seeds: range) -> Iterator[str]:
    """Of motions that tell too little, line by line: what became of them, and how far off what was accepted is."""
    yield "| motion | target | refused | accepted, within what is stated | worst accepted, mm |"
    yield "|---|---|---|---|---|"
    for motion in MOTIONS:
        for kind in KINDS_OF:
            small = motion == "small tilts"
            how = {"tilt_deg": 3.0, "yaw_deg": 5.0} if small else {"motion": motion}
            all_of = [outcome(kind, sweep(kind, 60, seed, Noise(), **how)) for seed in seeds]
            accepted = [one for one in all_of if np.isfinite(one.error_mm)]
            true = sum(one.covered > 0 for one in accepted)
            worst = f"{max(one.error_mm for one in accepted):.1f}" if accepted else ""
            refused = f"{len(all_of) - len(accepted)} of {len(all_of)}"
            yield f"| {motion} | {kind} | {refused} | {true} of {len(accepted)} | {worst} |"


def known_table(seeds: range) -> Iterator[str]:
    """What not knowing the place costs, line by line: rms error over the image, root mean square over scenes."""
    yield "| target, 60 frames | place known | unknown | said 2 mm and 1 degree off, refined | the same, believed |"
    yield "|---|---|---|---|---|"
    for kind in KINDS_OF:
        errors = []
        for seed in seeds:
            scene, random = sweep(kind, 60, seed, Noise()), np.random.default_rng(seed)
            turn = Rotation.from_rotvec(np.deg2rad(1) * random.normal(size=3)).as_matrix()
            middle = scene.place.mean(axis=0)
            said = (scene.place - middle) @ turn.T + middle + 2 * random.normal(size=3)
            asked = (
                UnplacedTarget(kind, scene.place),
                UnplacedTarget(kind),
                UnplacedTarget(kind, said, 2.0, 1.0),
                UnplacedTarget(kind, said),
            )
            errors.append([_error_mm(scene, target) for target in asked])
        shown = " | ".join(f"{one:.2f} mm" for one in np.sqrt(np.nanmean(np.square(errors), axis=0)))
        yield f"| {kind} | {shown} |"


def _error_mm(scene: Sweep, target: UnplacedTarget) -> float:
    try:
        answer = register_unplaced(scene.points_px[:, :2], scene.poses, [target], frame=scene.frame)
    except SonocalError:
        return np.nan
    return float(np.sqrt(np.mean(off_mm(answer, scene, image_points()) ** 2)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table, and write it into a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--write", type=Path, help="page whose table to replace")
    parser.add_argument("--exact", action="store_true", help="of scenes without noise, instead")
    parser.add_argument("--motions", action="store_true", help="of motions that tell too little, instead")
    parser.add_argument("--known", action="store_true", help="beside targets whose place is known, instead")
    asked = parser.parse_args(arguments)
    seeds = range(asked.first_seed, asked.first_seed + asked.scenes)
    name, of = "places", table
    if asked.exact:
        name, of = "places-exact", exact_table
    elif asked.motions:
        name, of = "places-motions", motion_table
    elif asked.known:
        name, of = "places-known", known_table
    tell(((name, line) for line in of(seeds)), asked.write)


if __name__ == "__main__":
    main()
