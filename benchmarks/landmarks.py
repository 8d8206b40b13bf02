"""Phantoms registered by their landmarks: one real session beside PLUS, and simulated ones beside their truth.

    python -m benchmarks.landmarks [--sessions 100] [--seed 1000]

Thresholds were chosen on seeds below 1000. The simulator shares no code with what it measures.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from benchmarks.simulators.landmark_session import BOX, EIGHT, TIP, session
from sonocal import SonocalError
from sonocal.geometry.fitted import fitted_motions
from sonocal.recording import Poses, Recording
from sonocal.recording.formats import read_recording
from sonocal.targets import Line, Point, read_device_set
from sonocal.tools import Stylus, register_landmarks

DATA = Path(__file__).parent.parent.parent / "shared" / "data" / "recordings"
WIRE = np.array([[30.0, 0.0, 20.0], [55.0, 40.0, 0.0]])
RIGHT_MM = 1.0


def registered(times, poses, landmarks, **options):
    """What sonocal makes of a session."""
    pose = Poses.of("Stylus", "Reference", poses)
    recording = Recording(times, poses={pose.name: pose})
    points = [Point(f"#{i + 1}", "Phantom", place) for i, place in enumerate(landmarks)]
    return register_landmarks(
        recording, points, Stylus("Stylus", TIP), targets=[Line("wire", "Phantom", WIRE)], **options
    )


def one(seed, landmarks=EIGHT, **options):
    """A session: what was found or refused, and its truth."""
    rng = np.random.default_rng(seed)
    in_order = options.pop("in_order", False)
    times, poses, truth, order = session(rng, landmarks, **options)
    try:
        return registered(times, poses, landmarks, in_order=in_order), truth, order
    except SonocalError as error:
        return error, truth, order


def is_right(found, truth, landmarks):
    """Whether every landmark is where it should be."""
    if isinstance(found, SonocalError):
        return False
    moved = found.reference_from_phantom - truth
    return np.linalg.norm(landmarks @ moved[:3, :3].T + moved[:3, 3], axis=1).max() < RIGHT_MM


def covered(found, truth):
    """Of the six numbers, and of a wire's ends, whether each is within its 95 %."""
    turn = Rotation.from_matrix(truth[:3, :3] @ found.reference_from_phantom[:3, :3].T).as_rotvec()
    off = np.concatenate([turn, truth[:3, 3] - found.reference_from_phantom[:3, 3]])
    limit = student.ppf(0.975, found.freedom) * np.sqrt(np.diag(found.covariance))
    moved = found.reference_from_phantom - truth
    ends = np.linalg.norm(WIRE @ moved[:3, :3].T + moved[:3, 3], axis=1)
    return np.abs(off) < limit, ends < found.within_95_mm(WIRE)


def simulated(name, sessions, seed, landmarks=EIGHT, **options):
    """Print how many sessions of a kind are right, wrong and refused, and what the intervals cover."""
    right = wrong = refused = complete = 0
    six, wires, codes = [], [], {}
    for i in range(sessions):
        found, truth, _ = one(seed + i, landmarks, **options)
        if isinstance(found, SonocalError):
            refused += 1
            code = getattr(found, "code", type(found).__name__)
            codes[code] = codes.get(code, 0) + 1
            continue
        good = is_right(found, truth, landmarks)
        right, wrong = right + good, wrong + (not good)
        complete += all(x.used for x in found.landmarks)
        for finding in found.diagnostics:
            if finding.severity == "warning":
                codes[finding.code] = codes.get(finding.code, 0) + 1
        if good:
            a, b = covered(found, truth)
            six.append(a)
            wires.append(b)
    cover = f"covered {np.mean(six):6.1%} of six numbers, {np.mean(wires):6.1%} of wire ends" if six else ""
    print(
        f"{name:34} right {right:3} wrong {wrong:2} refused {refused:3} all landmarks {complete:3}  {cover}  {codes}"
    )


def real():
    """The real session beside PLUS's own answer."""
    recording = read_recording(DATA / "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha")
    devices = read_device_set(DATA / "PlusDeviceSet_fCal_Sim_RecordPhantomLandmarks.xml")
    plus = read_device_set(DATA / "PhantomRegistrationLandmarkDetection.results.xml")
    plus = plus.transforms["Reference", "Phantom"]
    tip = devices.transforms["Stylus", "StylusTip"][:3, 3]
    found = register_landmarks(recording, devices.landmarks, Stylus("Stylus", tip), targets=devices.wires)
    shift = np.abs(found.reference_from_phantom[:3, 3] - plus[:3, 3])
    turn = Rotation.from_matrix(found.reference_from_phantom[:3, :3] @ plus[:3, :3].T).magnitude()
    print(
        f"real: {sum(x.used for x in found.landmarks)} of 8 landmarks, as listed: {found.as_listed}; from PLUS's "
        f"{np.linalg.norm(shift):.3f} mm and {np.degrees(turn):.3f} deg; mean residual {found.mean_mm:.3f} mm "
        "(PLUS 0.198)"
    )
    stylus = recording.between("Reference", "Stylus").matrices
    places = stylus[:, :3, :3] @ tip + stylus[:, :3, 3]
    touches = [
        rest for rest in found.rests if any((rest.first, rest.last) in x.frames for x in found.landmarks)
    ]
    landmarks = np.array([x.place_mm for x in devices.landmarks])
    for seconds in (0.67, 1.0, 2.0, 10.0):
        means = np.array([places[rest.rows[: round(15 * seconds)]].mean(axis=0) for rest in touches])
        motion = fitted_motions(landmarks, means)
        left = np.linalg.norm(landmarks @ motion[:3, :3].T + motion[:3, 3] - means, axis=1).mean()
        print(f"  of the first {seconds:g} s of each touch alone: mean residual {left:.3f} mm")


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1000)
    given = parser.parse_args()
    n, seed = given.sessions, given.seed
    if DATA.exists():
        real()
    simulated("eight, any order, two false", n, seed)
    simulated("the same, in the order listed", n, seed, order=range(8), in_order=True)
    simulated("no error of seating", n, seed, seat_mm=0.0)
    simulated("five of eight touched", n, seed, order=(6, 0, 3, 5, 2))
    simulated("a box: any order", n, seed, BOX, order=(3, 6, 0, 5, 2, 7, 1, 4))
    simulated("a box in the order listed", n, seed, BOX, order=range(8))
    simulated("nothing touched but air", n, seed, order=(), false=8)
    simulated("a tip 8 mm off", n, seed, tip_error_mm=8.0)


if __name__ == "__main__":
    main()
