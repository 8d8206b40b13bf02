"""What a probe has still to do over a target that nobody placed."""

import numpy as np
import pytest
from benchmarks.simulators.places import Noise, sweep

import sonocal as sc
from sonocal.registration.unplaced import UnplacedTarget, register_unplaced
from sonocal.sweep.how_to_move import how_to_move


@pytest.mark.parametrize(
    ("motion", "missing"),
    [("translation", "translation"), ("about u", "one-axis"), ("yaw", "one-axis"), ("free", "")],
)
def test_what_is_missing_is_what_a_calibration_refuses_by(motion, missing):
    scene = sweep("line", 60, 4, Noise(), motion=motion)
    told = how_to_move(scene.poses)
    assert told.missing == missing
    assert bool(told.advice) == bool(missing)
    if missing:
        with pytest.raises(sc.DegenerateGeometryError) as refused:
            register_unplaced(scene.points_px[:, :2], scene.poses, [UnplacedTarget("line")])
        assert refused.value.code == f"unplaced-{missing}"


def test_small_tilts_are_to_be_larger_and_poses_that_are_lost_do_not_count():
    scene = sweep("plane", 60, 4, Noise(), tilt_deg=15.0)
    poses = scene.poses.copy()
    told = how_to_move(poses)
    assert told.missing == "more"
    assert "tilt the probe further" in told.advice
    poses[::3] = np.nan
    assert how_to_move(poses).missing == "more"
    poses[:] = np.nan
    assert how_to_move(poses).missing == "translation"
    assert how_to_move(poses[:0]).missing == "translation"
    with pytest.raises(sc.InputError, match=r"must have shape \(N, 4, 4\); got \(4, 4\)"):
        how_to_move(np.eye(4))


def test_the_frames_in_which_poses_are_given_do_not_matter():
    scene = sweep("point", 40, 7, Noise())
    turned = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turned *= np.sign(np.linalg.det(turned))
    other = np.eye(4)
    other[:3, :3], other[:3, 3] = turned, [5, 6, 7]
    one, both = how_to_move(scene.poses), how_to_move(other @ scene.poses @ other)
    np.testing.assert_allclose(one.turns_deg, both.turns_deg, atol=1e-6)
