"""Nearly parallel wires leave an image's tilt open: labels are settled under the mirrored one, too, and compared."""

import numpy as np
import pytest
from benchmarks.simulators import phantoms
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal import registration as reg
from sonocal.errors import DegenerateGeometryError
from sonocal.observations import Observations
from sonocal.registration.label_rivals import TILTED, rival_starts
from sonocal.registration.label_table import LabelTable


def leaning_scan(seed, turn_rad, lean_mm=0.0):
    """Seven wires, parallel but for `lean_mm`, 25 degrees off the image's normal."""
    rng = np.random.default_rng(seed)
    near = phantoms._apart(rng, 7)
    wires = phantoms._ends(near, near + rng.uniform(-lean_mm, lean_mm, near.shape))
    axis = rng.normal(size=2)
    leaning = Rotation.from_rotvec(np.radians(25) * np.append(axis / np.linalg.norm(axis), 0.0)).as_matrix()
    return phantoms.scan(rng, wires @ leaning.T, 12, turn_rad=turn_rad)


def found_in(dots):
    found = reg.associate(dots.points, dots.wires, frame=dots.frame, time_limit_s=60.0)
    given = found.labels >= 0
    assert found.verdict == "found", found.reason
    np.testing.assert_array_equal(found.labels[given], dots.truth[given])
    return found


@pytest.mark.parametrize("lean_mm", [0.0, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_from_one_side_the_mirrored_tilt_is_a_rival_with_the_same_labels(seed, lean_mm):
    found = found_in(leaning_scan(seed, 0.003, lean_mm))
    (rival,) = found.rivals
    assert rival.name == TILTED and "the mirrored tilt has the same labels" in found.reason
    assert rival.share_of_labels <= 0.02 and rival.apart_mm > 10.0
    # What chooses dots again under it finds as many, as near to their wires.
    assert np.count_nonzero(rival.labels >= 0) >= 0.95 * np.count_nonzero(found.labels >= 0)
    assert rival.score == pytest.approx(found.score, rel=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_mirrored_twice_the_answer_comes_back(seed):
    dots = leaning_scan(seed, 0.003)
    found = found_in(dots)
    table = LabelTable.of(dots.points, dots.wires, dots.frame)
    (other,) = table.settled(found.rivals[0].target_from_source.matrix[None], found.threshold_mm)
    name, start = next(iter(rival_starts(table, other)))
    (back,) = table.settled(start[None], found.threshold_mm)
    places = np.column_stack([dots.points, np.zeros(len(dots.points))])
    assert name == TILTED
    away = found.target_from_source @ places - (back.matrix[:3, :2] @ dots.points.T).T - back.matrix[:3, 3]
    assert np.linalg.norm(away, axis=1).max() < 0.5


@pytest.mark.parametrize("seed", range(4))
def test_from_many_sides_the_mirrored_tilt_is_excluded(seed):
    found = found_in(leaning_scan(seed, 0.1))
    assert not found.rivals


def test_a_calibration_of_such_labels_is_refused_for_what_they_leave_open():
    dots = leaning_scan(0, 0.003)
    labels = found_in(dots).labels
    kept = np.flatnonzero(labels >= 0)
    rows = Observations(
        frame=dots.frame[kept],
        target=labels[kept].astype(str),
        points_px=dots.points[kept],
        segments_mm=dots.wires[dots.frame[kept], labels[kept]],
    )
    with pytest.raises(DegenerateGeometryError, match="of one direction"):
        sc.calibrate(rows)
