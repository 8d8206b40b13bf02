"""Points to validate by, as someone gives them who means harm or has slipped."""

import numpy as np
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.validation import fit_crosswire, fixed_point_spread, reconstruction_accuracy
from sonocal.validation.point_table import PointSightings, parse_point_sightings
from tests.builders.hostile import Hostile

HEADER = "u_px,v_px,x_mm,y_mm,z_mm"


def points(h: Hostile) -> PointSightings:
    """A cross-wire or beads, with places, poses or both."""
    rows = h.pick([1, 2, 6, 20])
    turns = Rotation.from_rotvec(h.random.normal(size=(rows, 3)) * h.pick([1.0, 1.0, 0.0, 1e-3]))
    poses = np.tile(np.eye(4), (rows, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = turns.as_matrix(), h.random.uniform(-200, 200, (rows, 3))
    return PointSightings(
        h.array(h.random.uniform(0, 500, (rows, h.pick([2, 2, 3])))),
        h.pick([None, h.array(h.random.uniform(-100, 100, (rows, 3)))]),
        h.pick([None, h.array(poses)]),
        **({"target": h.array(np.arange(rows) % 3, np.int64)} if h.random.random() < 0.3 else {}),
    )


def written(h: Hostile) -> PointSightings:
    """The same as a file."""
    cells = h.random.uniform(0, 300, (4, 5)).tolist()
    if h.spoils():
        cells[2][int(h.random.integers(5))] = h.pick(
            ["nan", "1e400", "1e200", "", "far", "-0", "1_0", "0x10"]
        )
    text = "\n".join([HEADER, *(",".join(map(str, row)) for row in cells)])
    return parse_point_sightings(h.pick([text, text + "\n", text[: len(text) // 2]]).encode(), "points.csv")


def pointed(h: Hostile, found: sc.Calibration) -> None:
    """Everything that is asked of points."""
    given = h.pick([points, points, written])(h)
    for number in (reconstruction_accuracy, fixed_point_spread):
        try:
            number(found.probe_from_image, given)
        except sc.SonocalError as error:
            assert "\n" not in str(error)
    fit_crosswire(given)
