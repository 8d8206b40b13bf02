"""An offset fixed in the tracker's frame is named in a recording, and what wanders is not taken for one."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.trust_faults import KINDS, Case, drift, wandering
from benchmarks.simulators.trust_judge import at_corners, calibrated
from benchmarks.simulators.trust_scans import sound

from sonocal.geometry import Similarity
from sonocal.registration.fixed_offset import fixed_offset
from sonocal.registration.mapped import MappedRows
from sonocal.registration.rows import PointLineRows

CODE = "offset-in-tracker"


def found(case):
    return calibrated(dataclasses.replace(case, recording=True))


def named(case):
    return CODE in [one.code for one in found(case).warnings]


def test_an_offset_of_the_tracker_s_frame_is_named_and_counted():
    kind = KINDS["offset in the tracker's frame"]
    for seed in range(10):
        case = kind.make(seed, 2.0)
        calibration = found(case)
        (message,) = (one.message for one in calibration.warnings if one.code == CODE)
        assert float(message.split("offset of ")[1].split(" mm")[0]) == pytest.approx(2.0, abs=0.5)
        errors, bounds = at_corners(calibration, case.scan)
        assert np.all(errors < 3 * bounds)


def test_a_sound_recording_has_none():
    assert sum(named(Case(sound(seed, 100))) for seed in range(12)) <= 1


@pytest.mark.parametrize("make", [drift, wandering])
def test_a_marker_that_drifts_is_not_called_an_offset(make):
    assert sum(named(make(seed, 2.0)) for seed in range(12)) <= 1


@pytest.mark.parametrize("turned", [slice(0, 0), slice(3, 5)])
def test_a_frame_that_hardly_turned_shows_none(turned):
    """Turned never, or for a moment that lies in one of the stretches that are left out."""
    scan = sound(1, 100)
    points = np.column_stack([scan.points_px[:, 0], np.zeros(100)])
    rows = PointLineRows(points, scan.segments_mm(), 2, frame=np.arange(100, dtype=np.int32))
    scale = float(np.linalg.norm(scan.truth[:3, 0]))
    mapped = MappedRows(Similarity(scan.truth[:3, :3] / scale, scan.truth[:3, 3], scale), rows)
    rotations = np.tile(np.eye(3), (100, 1, 1))
    rotations[turned] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    seen = fixed_offset(mapped, np.ones(100, dtype=bool), rotations, 7)
    assert seen is None or seen.p_value > 1e-3
