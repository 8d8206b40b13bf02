"""The tip by pivoting."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.recording.formats import read_recording
from sonocal.tools import calibrate_pivot
from tests.builders.recordings import random_poses
from tests.builders.tracked_tools import TIP, pivoting, spinning

# LSQRRecipes' own test of its poses: from the first, the middle and the last pose alone, and from all.
THREE_POSES_TIP = np.array([-18.586, 1.98134, -157.439])


LEAST_SQUARES_TIP = np.array([-17.7799, 1.1113, -156.865])


def real_poses(data_folder):
    table = np.loadtxt(data_folder / "pivot" / "tool_poses.txt")
    matrices = np.tile(np.eye(4), (len(table), 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(table[:, 3:]).as_matrix()
    matrices[:, :3, 3] = table[:, :3]
    return matrices


@given(st.integers(0, 10**6))
def test_pivot_without_noise_is_exact(seed):
    found = calibrate_pivot(pivoting(np.random.default_rng(seed), noise_mm=0.0))
    np.testing.assert_allclose(found.tip_mm, TIP, atol=1e-8)
    assert found.inlier.all()


def test_moving_the_marker_moves_the_tip_with_it():
    rng = np.random.default_rng(1)
    poses, other_from_tool = pivoting(rng), random_poses(rng, 1)[0]
    found, moved = calibrate_pivot(poses), calibrate_pivot(poses @ np.linalg.inv(other_from_tool))
    np.testing.assert_allclose(
        moved.tip_mm, other_from_tool[:3, :3] @ found.tip_mm + other_from_tool[:3, 3], atol=1e-8
    )
    np.testing.assert_allclose(moved.pivot_mm, found.pivot_mm, atol=1e-8)
    assert moved.rms_mm == pytest.approx(found.rms_mm)


def test_pivot_covariance_covers_the_truth():
    """The squared error, measured by the covariance, is chi-squared with three degrees of freedom."""
    distances = []
    for seed in range(40):
        found = calibrate_pivot(pivoting(np.random.default_rng(seed), noise_mm=0.5))
        error = found.tip_mm - TIP
        distances.append(error @ np.linalg.solve(found.covariance[:3, :3], error))
    # 7.81 is the 95 % point; the blockwise covariance has few degrees of freedom, so allow some more beyond.
    assert np.mean(np.array(distances) < 7.81) > 0.85
    assert 1.0 < np.mean(distances) < 5.0


def test_real_pivot_agrees_with_its_reference(data_folder):
    found = calibrate_pivot(real_poses(data_folder))
    assert np.abs(found.tip_mm - THREE_POSES_TIP).max() < 1.0
    np.testing.assert_allclose(found.tip_mm, LEAST_SQUARES_TIP, atol=1e-3)
    assert found.rms_mm == pytest.approx(0.51, abs=0.01)
    assert 0.02 < found.tip_deviation_mm < 0.5
    assert found.diagnostics == ()


def test_the_quoted_reference_is_the_answer_of_three_poses(data_folder):
    """Hence it is further from least squares than the tip's own error."""
    poses = real_poses(data_folder)
    three = poses[[0, len(poses) // 2, len(poses) - 1]]
    system = np.concatenate([three[:, :3, :3], np.tile(-np.eye(3), (3, 1, 1))], axis=2).reshape(9, 6)
    tip = np.linalg.lstsq(system, -three[:, :3, 3].reshape(9), rcond=None)[0][:3]
    np.testing.assert_allclose(tip, THREE_POSES_TIP, atol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_gross_outliers_do_not_move_the_tip(data_folder, seed):
    clean = real_poses(data_folder)
    rng = np.random.default_rng(seed)
    bad = rng.choice(len(clean), int(0.3 * len(clean)), replace=False)
    spoiled = clean.copy()
    spoiled[bad] = random_poses(rng, len(bad), spread_mm=1500)
    found = calibrate_pivot(spoiled, seed=seed)
    assert np.abs(found.tip_mm - THREE_POSES_TIP).max() < 1.0
    np.testing.assert_allclose(found.tip_mm, calibrate_pivot(clean).tip_mm, atol=0.1)
    assert not found.inlier[bad].any()
    assert found.inlier.sum() == len(clean) - len(bad)


def test_same_seed_same_tip():
    poses = pivoting(np.random.default_rng(0))
    assert calibrate_pivot(poses, seed=4).tip_mm.tobytes() == calibrate_pivot(poses, seed=4).tip_mm.tobytes()


def test_a_static_stretch_is_refused(data_folder):
    still = np.repeat(real_poses(data_folder)[:1], 100, axis=0)
    still[:, :3, 3] += np.random.default_rng(0).normal(0, 0.1, (100, 3))
    with pytest.raises(DegenerateGeometryError) as caught:
        calibrate_pivot(still, source="pivot.igs.mha")
    assert caught.value.code == "still"
    assert str(caught.value) == (
        "pivot.igs.mha: the tool hardly turned (0.00 deg rms), so any tip fits; "
        "rest the tip in a divot and tilt the tool by 30 deg or more, to all sides"
    )


def test_a_real_tool_at_rest_is_refused(data_folder):
    """A stylus that lies on the table for a whole recording, and the first second of a real pivot."""
    resting = read_recording(data_folder / "recordings" / "fCal_Test_Calibration_3NWires.igs.mha").tool(
        "Stylus"
    )
    for poses, code in ((resting.matrices, "still"), (real_poses(data_folder)[:20], "little-tilt")):
        with pytest.raises(DegenerateGeometryError) as caught:
            calibrate_pivot(poses)
        assert caught.value.code == code


def test_a_pivot_about_one_axis_is_refused():
    with pytest.raises(
        DegenerateGeometryError, match=r"the tip is free along \(-?0\.10, -?0\.20, -?0\.97\)"
    ) as caught:
        calibrate_pivot(spinning(np.random.default_rng(0)))
    assert caught.value.code == "little-tilt"


def test_too_little_tilt_is_warned_of_with_the_tips_error():
    found = calibrate_pivot(pivoting(np.random.default_rng(0), tilt_deg=6.0))
    assert "little-tilt" in [d.code for d in found.diagnostics]
    good = calibrate_pivot(pivoting(np.random.default_rng(0)))
    assert found.rms_mm == pytest.approx(good.rms_mm, abs=0.02)  # the residual says nothing
    assert found.tip_deviation_mm > 3 * good.tip_deviation_mm


def test_a_slipped_tip_is_warned_of():
    rng = np.random.default_rng(0)
    poses = pivoting(rng)
    poses[120:, :3, 3] += [1.0, 0.5, 0.0]
    found = calibrate_pivot(poses)
    assert "slipped-tip" in [d.code for d in found.diagnostics]
    assert "slipped-tip" not in [d.code for d in calibrate_pivot(pivoting(rng)).diagnostics]


def test_poses_without_a_tip_have_no_consensus():
    with pytest.raises(NoConsensusError, match=r"only \d+ of 100 poses share a tip within 5 mm; rest"):
        calibrate_pivot(random_poses(np.random.default_rng(0), 100, spread_mm=1e5))


def test_what_cannot_be_a_pivot_is_refused():
    poses = pivoting(np.random.default_rng(0))
    with pytest.raises(InputError, match="has 9 valid poses; a tool calibration needs 10"):
        calibrate_pivot(poses, valid=np.arange(200) < 9)
    poses[17, :3, :3] *= 1.1
    with pytest.raises(InputError, match=r"poses, frame 17: its pose is not rigid \(det R = 1.33\)"):
        calibrate_pivot(poses)


@pytest.mark.parametrize(("order", "how"), [([3, 0, 1, 2], "first"), ([1, 2, 3, 0], "last")])
def test_quaternions_in_the_other_order_are_named(order, how):
    poses = pivoting(np.random.default_rng(3))
    quaternions = np.roll(Rotation.from_matrix(poses[:, :3, :3]).as_quat(), 1, axis=1)[:, order]
    poses[:, :3, :3] = Rotation.from_quat(np.roll(quaternions, -1, axis=1)).as_matrix()
    said = f"they do when they are read with the scalar of their quaternions {how}: write them as they are meant$"
    with pytest.raises(NoConsensusError, match=said):
        calibrate_pivot(poses)
