"""Phantoms put in place by dragging a stylus along their faces and edges, beside the truth of simulated sessions.

    python -m benchmarks.drags [--sessions 100] [--seed 1000]

Thresholds were chosen on seeds below 1000. The simulator shares no code with what it measures.
"""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from benchmarks.simulators.drag_session import DIVOTS, EDGES, FACES, TIP, drag_session
from sonocal import SonocalError
from sonocal.recording import Poses, Recording
from sonocal.targets import Line, Plane, Point
from sonocal.tools import Stylus, register_features

WIRE = np.array([[20.0, 0.0, 20.0], [70.0, 60.0, 15.0]])
RIGHT_MM = 1.5
# What is dragged along and touched.
SETS = {
    "three faces, an edge, two divots": ("front", "left", "roof", "left edge", 0, 1),
    "three faces, two edges": ("front", "left", "roof", "right edge", "front edge"),
    "four faces": ("front", "left", "roof", "back"),
    "three faces": ("front", "left", "roof"),
    "two edges, three divots": ("left edge", "right edge", 0, 1, 2),
}


def targets_of(names):
    """Lines and planes of those names, in the phantom's frame."""
    return [
        Line(name, "Phantom", EDGES[name]) if name in EDGES else Plane(name, "Phantom", FACES[name])
        for name in names
        if isinstance(name, str)
    ]


def points_of(places=DIVOTS):
    """Divots by their numbers."""
    return [Point(f"#{i + 1}", "Phantom", place) for i, place in enumerate(places)]


def registered(times, poses, dragged, landmarks=None, **options):
    """What sonocal makes of a session."""
    pose = Poses.of("Stylus", "Reference", poses)
    recording = Recording(times, poses={pose.name: pose})
    landmarks = points_of() if landmarks is None else landmarks
    wires = [Line("wire", "Phantom", WIRE)]
    return register_features(recording, landmarks, dragged, Stylus("Stylus", TIP), targets=wires, **options)


def one(seed, listed, *, in_order=False, shuffled=True, **options):
    """A session: what was found or refused, its truth, and what was done when."""
    rng = np.random.default_rng(seed)
    order = [listed[i] for i in rng.permutation(len(listed))] if shuffled else listed
    times, poses, truth, spans = drag_session(rng, order, **options)
    landmarks = points_of() if any(not isinstance(x, str) for x in listed) else []
    try:
        return registered(times, poses, targets_of(listed), landmarks, in_order=in_order), truth, spans
    except SonocalError as error:
        return error, truth, spans


def off_mm(found, truth):
    """How far the wire's ends are off."""
    moved = found.reference_from_phantom - truth
    return np.linalg.norm(WIRE @ moved[:3, :3].T + moved[:3, 3], axis=1)


def covered(found, truth):
    """Of the six numbers, and of a wire's ends, whether each is within its 95 %."""
    turn = Rotation.from_matrix(truth[:3, :3] @ found.reference_from_phantom[:3, :3].T).as_rotvec()
    off = np.concatenate([turn, truth[:3, 3] - found.reference_from_phantom[:3, 3]])
    limit = student.ppf(0.975, found.freedom) * np.sqrt(np.diag(found.covariance))
    return np.abs(off) < limit, off_mm(found, truth) < found.within_95_mm(WIRE)


def main():
    """Print how many sessions of a kind are right, wrong and refused, and what the intervals cover."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1000)
    asked = parser.parse_args()
    for shuffled in (False, True):
        for name, listed in SETS.items():
            how = "any order" if shuffled else "in order"
            right, wrong, codes, six, ends, errors, drags = 0, 0, {}, [], [], [], []
            for seed in range(asked.seed, asked.seed + asked.sessions):
                found, truth, _ = one(seed, listed, in_order=not shuffled, shuffled=shuffled)
                if isinstance(found, SonocalError):
                    code = getattr(found, "code", "") or type(found).__name__
                    codes[code] = codes.get(code, 0) + 1
                    continue
                good = off_mm(found, truth).max() < RIGHT_MM
                right, wrong = right + good, wrong + (not good)
                errors.append(off_mm(found, truth).max())
                drags.append(all(x.used for x in found.features))
                a, b = covered(found, truth)
                six.append(a)
                ends.append(b)
                for finding in found.diagnostics:
                    if finding.severity == "warning":
                        codes[finding.code] = codes.get(finding.code, 0) + 1
            print(
                f"{name:34} {how:9} right {right:3} wrong {wrong:2} all drags {sum(drags):3} "
                f"median {np.median(errors) if errors else np.nan:.2f} mm, "
                f"covered {np.mean(six) if six else 0:6.1%} of six numbers, "
                f"{np.mean(ends) if ends else 0:6.1%} of wire ends  {codes}",
                flush=True,
            )


if __name__ == "__main__":
    main()
