"""What it costs not to know where a target is: known, unknown, known roughly, and believed where it is not."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.places_scenes import registered, rms_mm
from benchmarks.simulators.places import Noise, Sweep, sweep
from benchmarks.simulators.places_bound import least_error_mm
from benchmarks.simulators.places_hand import Kind
from sonocal.errors import SonocalError
from sonocal.registration.unplaced import UnplacedTarget

__all__ = ["known_table"]

OFF = 2.0, 1.0
"""Mm along each axis, degrees about each: how wrong a place is that is said."""


class Case(NamedTuple):
    """A target, and how it is held and seen."""

    name: str
    kind: Kind
    tracked: bool = False
    points_each: int | None = None


CASES = (
    Case("a cross of two threads", "point"),
    Case("a thread", "line"),
    Case("a needle that is tracked", "line", tracked=True),
    Case("a floor, two points an image", "plane"),
    Case("a floor, one point an image", "plane", points_each=1),
)


def known_table(seeds: range) -> Iterator[str]:
    """Line by line: rms error over the image, root mean square over scenes, and the least that it can be."""
    yield "| target, 60 frames | place known | unknown | said 2 mm and 1 degree off, refined | the same, believed |"
    yield "|---|---|---|---|---|"
    for case in CASES:
        errors, least = [], []
        for seed in seeds:
            scene = sweep(case.kind, 60, seed, Noise(), tracked=case.tracked, points_each=case.points_each)
            said = _mistaken(scene, seed)
            asked = (
                UnplacedTarget(case.kind, scene.place),
                UnplacedTarget(case.kind),
                UnplacedTarget(case.kind, said, *OFF),
                UnplacedTarget(case.kind, said),
            )
            errors.append([_error_mm(scene, case.kind, target) for target in asked])
            knowing: tuple[dict[str, object], ...] = ({"known": True}, {}, {"prior": OFF})
            least.append([least_error_mm(scene, Noise(), **how)[0] for how in knowing])  # type: ignore[arg-type]
        cells = [f"{one:.2f} mm" for one in np.sqrt(np.nanmean(np.square(errors), axis=0))]
        bounds = [f" ({one:.2f})" for one in np.sqrt(np.mean(np.square(least), axis=0))] + [""]
        refused = np.count_nonzero(np.isnan(errors))
        shown = " | ".join(cell + bound for cell, bound in zip(cells, bounds, strict=True))
        yield f"| {case.name} | {shown} |" + (f" <!-- {refused} refused -->" if refused else "")


def _mistaken(scene: Sweep, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(np.deg2rad(OFF[1]) * random.normal(size=3)).as_matrix()
    middle = scene.place.mean(axis=0)
    return np.asarray((scene.place - middle) @ turn.T + middle + OFF[0] * random.normal(size=3))


def _error_mm(scene: Sweep, kind: Kind, target: UnplacedTarget) -> float:
    try:
        return rms_mm(registered(scene, kind, target), scene)
    except SonocalError:
        return np.nan
