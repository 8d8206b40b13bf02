"""A phantom of known shape and unknown place, found with the calibration: errors and what the stated ones cover.

    python -m benchmarks.phantom_places [--seeds 40] [--first-seed 1000]

Beside it, with --apart, the same sweeps with each wire's place unknown by itself; and whether the phantom agrees with
landmarks that are off by 0.3 mm and 0.3 deg. The simulator shares no code with what it measures.
"""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import sonocal as sc
from benchmarks.simulators.phantom_sweep import IMAGE_PX, N_WIRES, PARALLEL, THREE, phantom_sweep
from sonocal import SonocalError
from sonocal.targets import Line, Phantom, Unplaced
from sonocal.targets.unplaced import of_phantom

CORNERS = np.array([[0, 0, 0], [*IMAGE_PX, 0], [IMAGE_PX[0], 0, 0], [0, IMAGE_PX[1], 0], [*IMAGE_PX / 2, 0]])
SAID_MM, SAID_DEG = 0.3, 0.3


def table(scene, name="sweep"):
    """Its rows, each with the pose of what the phantom is fixed to, and its wire's name."""
    posed = {
        f"probe_from_target_{i}{j}": scene.poses[:, i, j].astype(np.str_) for i in range(3) for j in range(4)
    }
    return sc.Observations.of_targets(
        scene.points_px,
        np.full((len(scene.frame), 3, 3), np.nan),
        frame=scene.frame,
        target=np.array([f"wire {k}" for k in scene.wire]),
        extra=posed,
        source=name,
    )


def wires_of(wires, fixed_to="Tracker", said=None):
    """The wires of a phantom whose place is unknown."""
    phantom = Phantom("Phantom", fixed_to, said, SAID_MM, SAID_DEG)
    return [of_phantom(phantom, Line(f"wire {k}", "Phantom", ends)) for k, ends in enumerate(wires)]


def said_of(scene, seed, off=1.0):
    """Where landmarks said that it is."""
    rng = np.random.default_rng([seed, 7])
    shake = np.eye(4)
    shake[:3, :3] = Rotation.from_rotvec(np.radians(SAID_DEG) * off * rng.normal(size=3)).as_matrix()
    said = scene.place.copy()
    said[:3, :3] = shake[:3, :3] @ said[:3, :3]
    said[:3, 3] += SAID_MM * off * rng.normal(size=3)
    return said


def error_mm(found, scene):
    """At the image's corners and middle."""
    there = CORNERS @ scene.truth[:3, :3].T + scene.truth[:3, 3]
    return np.linalg.norm(found.probe_from_image @ CORNERS - there, axis=1)


def place_off(found, scene):
    """The six numbers of the phantom's place, in their deviations' units of 95 %."""
    place = np.array(found.phantom.place)
    turn = Rotation.from_matrix(scene.place[:3, :3] @ place[:3, :3].T).as_rotvec()
    off = np.concatenate([turn, scene.place[:3, 3] - place[:3, 3]])
    return np.abs(off) / (1.96 * np.sqrt(np.diag(np.array(found.phantom.covariance))))


def corners_covered(found, scene):
    """Whether the image's corners are within the 95 % that is stated."""
    from sonocal.registration.uncertainty import point_covariance, radius_95

    within = radius_95(
        point_covariance(found.probe_from_image, found.covariance, CORNERS), found.noise.freedom
    )
    return error_mm(found, scene) < within


SCENES = {
    "two N and a wire, 60 images": {},
    "the same, tilts of 5 deg": {"tilt_deg": 5.0, "turn_deg": 5.0},
    "the same, 20 images": {"frames": 20},
    "the same, a tenth of the dots wrong": {"wrong": 0.1},
    "three wires, 60 images": {"wires": THREE},
    "fixed to a tracked reference": {"tracked": True},
    "no tilt, shifts alone": {"tilt_deg": 0.0, "turn_deg": 0.0},
    "wires off by 0.5 mm": {"shape_mm": 0.5},
    "parallel wires": {"wires": PARALLEL},
}


def main():
    """Print a row a scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument(
        "--apart", action="store_true", help="each wire's place by itself, too: takes minutes"
    )
    asked = parser.parse_args()
    for name, options in SCENES.items():
        rows, apart, agree, codes = [], [], [], {}
        for seed in range(asked.first_seed, asked.first_seed + asked.seeds):
            scene = phantom_sweep(seed, **options)
            wires, to = options.get("wires", N_WIRES), "Reference" if options.get("tracked") else "Tracker"
            try:
                found = sc.calibrate(table(scene), targets=wires_of(wires, to, said_of(scene, seed)))
            except SonocalError as error:
                code = getattr(error, "code", "") or type(error).__name__
                codes[code] = codes.get(code, 0) + 1
                continue
            for finding in found.diagnostics:
                if finding.code in {"phantom-shape", "phantom-elsewhere"}:
                    codes[finding.code] = codes.get(finding.code, 0) + 1
            rows.append(
                (
                    error_mm(found, scene).max(),
                    corners_covered(found, scene).mean(),
                    (place_off(found, scene) < 1).mean(),
                )
            )
            agree.append(found.phantom.agrees)
            if not asked.apart:
                continue
            free = [Unplaced("line", one.name, to) for one in wires_of(wires)]
            try:
                apart.append(error_mm(sc.calibrate(table(scene), targets=free), scene).max())
            except SonocalError:
                apart.append(np.inf)
        errors, corners, six = np.array(rows).T if rows else np.full((3, 1), np.nan)
        print(
            f"{name:36} found {len(rows):3} of {asked.seeds}: worst corner {np.median(errors):.2f} mm (most "
            f"{errors.max():.2f}), each wire by itself {np.median(apart) if apart else np.nan:.2f}; covered corners "
            f"{corners.mean():.1%}, place {six.mean():.1%}; landmarks agree {sum(map(bool, agree))} of {len(agree)} "
            f"{codes}",
            flush=True,
        )


if __name__ == "__main__":
    main()
