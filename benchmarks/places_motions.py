"""What becomes of motions that tell too little of a calibration and a target's place, and of sound ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from benchmarks.places_scenes import Outcome, outcome
from benchmarks.simulators.places import Noise, sweep
from benchmarks.simulators.places_hand import MOTIONS, Kind

__all__ = ["motion_table"]

BOUNDED = 1.5
"""Times the 95 % stated: where chance leads in 3 of 1000, at the most."""
KINDS: tuple[Kind, ...] = ("point", "line", "plane")


class Motion(NamedTuple):
    """How a probe is led, and whether that is enough."""

    name: str
    motion: str = "free"
    tilt_deg: float = 40.0
    yaw_deg: float = 180.0
    sound: bool = False


CASES = (
    *(Motion(name, name) for name in MOTIONS),
    Motion("turns of half a degree", tilt_deg=0.5, yaw_deg=0.5),
    Motion("turns of 3 degrees", tilt_deg=3.0, yaw_deg=3.0),
    Motion("sound: tilts to 40 degrees", sound=True),
    Motion("sound: tilts to 30, yaw to 60 degrees", tilt_deg=30.0, yaw_deg=60.0, sound=True),
)


def motion_table(seeds: range) -> Iterator[str]:
    """Line by line: what became of them, and how far off what was accepted is."""
    yield "| motion | target | refused | accepted, bounded truly | worst accepted | why |"
    yield "|---|---|---|---|---|---|"
    total: dict[bool, Counter[str]] = {True: Counter(), False: Counter()}
    for case in CASES:
        for kind in KINDS:
            all_of = [_outcome(kind, case, seed) for seed in seeds]
            accepted = [one for one in all_of if np.isfinite(one.error_mm)]
            true = sum(bool(np.all(one.corners < BOUNDED)) for one in accepted)
            worst = f"{max(one.error_mm for one in accepted):.1f} mm" if accepted else ""
            refused = len(all_of) - len(accepted)
            why = ", ".join(
                f"{code} {n}" for code, n in Counter(one.said for one in all_of if one.said).most_common(2)
            )
            yield f"| {case.name} | {kind} | {refused} of {len(all_of)} | {true} of {len(accepted)} | {worst} | {why} |"
            total[case.sound].update(scenes=len(all_of), refused=refused, good=refused + true)
    bad, sound = total[False], total[True]
    yield f"| all that tell too little | | refused or bounded truly: {bad['good']} of {bad['scenes']} | | | |"
    yield f"| all sound ones | | refused: {sound['refused']} of {sound['scenes']} | | | |"


def _outcome(kind: Kind, case: Motion, seed: int) -> Outcome:
    scene = sweep(kind, 60, seed, Noise(), motion=case.motion, tilt_deg=case.tilt_deg, yaw_deg=case.yaw_deg)
    return outcome(kind, scene, least=False)
