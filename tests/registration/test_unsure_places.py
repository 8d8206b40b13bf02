"""What a wall that may be elsewhere adds to the error is what moving it does to the answer."""

import numpy as np
from benchmarks.simulators.mixed_judge import table
from benchmarks.simulators.mixed_scans import PHANTOMS, sound

import sonocal as sc
from sonocal.registration.fit_targets import fit_targets
from sonocal.registration.mapped import MappedTargets
from sonocal.registration.options import Options
from sonocal.registration.uncertainty import point_covariance
from sonocal.registration.unsure_places import unsure_places
from tests.builders.target_rows import of_observations

CORNERS = np.array([[0.0, 0], [499, 0], [0, 499], [499, 499]])


def few_walls(seed, count):
    scan = sound("walls", seed, 25.0)
    kept = np.isin(scan.target, [f"wall {i}" for i in range(count)])
    _, frame = np.unique(scan.frame[kept], return_inverse=True)
    names = ("time_s", "target", "spans", "points_px", "spanning_mm", "tracker_from_probe")
    return scan.but(frame=frame, **{name: getattr(scan, name)[kept] for name in names})


def displaced(scan, mm):
    wall = scan.target == "wall 0"
    normal = np.cross(
        scan.spanning_mm[:, 1] - scan.spanning_mm[:, 0], scan.spanning_mm[:, 2] - scan.spanning_mm[:, 0]
    )[wall].mean(axis=0)
    moved = scan.spanning_mm.copy()
    moved[wall] += mm * normal / np.linalg.norm(normal)
    return scan.but(spanning_mm=moved)


def off(found, scan):
    return np.linalg.norm(
        found.probe_from_image @ CORNERS - (CORNERS @ scan.truth[:3, :2].T + scan.truth[:3, 3]), axis=1
    )


def test_the_bound_holds_where_one_of_few_walls_is_elsewhere():
    assert "walls" in PHANTOMS
    for seed in range(6):
        for mm in (0.0, 2.0, 5.0):
            scan = displaced(few_walls(seed, 2), mm)
            found = sc.calibrate(table(scan))
            assert np.all(off(found, scan) <= 1.5 * found.predicted_errors()[2][:4])


def test_what_a_moved_wall_does_is_what_it_is_said_to_do():
    for seed in range(4):
        rows = [of_observations(table(displaced(few_walls(seed, 3), mm))) for mm in (0.0, 3.0)]
        fits = [fit_targets(one, Options(threshold_mm=50.0)) for one in rows]
        added = unsure_places(MappedTargets(fits[1].transform, rows[1]), fits[1])
        assert np.linalg.eigvalsh(added).min() > -1e-6 * np.trace(added)
        way = fits[1].transform @ CORNERS - fits[0].transform @ CORNERS
        said = np.sqrt(np.trace(point_covariance(fits[1].transform, added, CORNERS), axis1=1, axis2=2))
        np.testing.assert_allclose(said, np.linalg.norm(way, axis=1), rtol=0.15, atol=0.15)
