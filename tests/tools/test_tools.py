"""Pivot, spin and needle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.recording import Poses
from sonocal.recording.formats import read_recording
from sonocal.targets import (
    Line,
    read_lines,
    write_lines,
)
from sonocal.tools import (
    calibrate_pivot,
    calibrate_spin,
    digitise_point,
    needle_from_axis,
    needle_from_points,
)
from tests.builders.recordings import random_poses

TIP = np.array([-18.0, 2.0, -157.0])
AXIS = np.array([0.1, -0.2, 0.97]) / np.linalg.norm([0.1, -0.2, 0.97])
# LSQRRecipes' own test of its poses: from the first, the middle and the last pose alone, and from all.
THREE_POSES_TIP = np.array([-18.586, 1.98134, -157.439])
LEAST_SQUARES_TIP = np.array([-17.7799, 1.1113, -156.865])


def pivoting(rng, n=200, tilt_deg=30.0, noise_mm=0.2, tip=TIP):
    """A tool tilted to all sides about its resting tip."""
    base = Rotation.random(random_state=rng)
    # A hand moves smoothly: tilts follow slow waves.
    t = np.linspace(0, 12, n)
    tilts = np.radians(tilt_deg) * np.column_stack([np.sin(t), np.cos(1.3 * t), np.sin(0.7 * t)])
    matrices = np.tile(np.eye(4), (n, 1, 1))
    matrices[:, :3, :3] = (base * Rotation.from_rotvec(tilts)).as_matrix()
    matrices[:, :3, 3] = (
        np.array([100, -50, -1000]) - matrices[:, :3, :3] @ tip + rng.normal(0, noise_mm, (n, 3))
    )
    return matrices


def spinning(rng, n=200, turn_deg=150.0, wobble_deg=0.1, axis=AXIS, point=TIP):
    """A tool spun about an axis that rests."""
    base = Rotation.random(random_state=rng)
    spin = Rotation.from_rotvec(np.radians(np.linspace(-turn_deg, turn_deg, n))[:, None] * axis)
    wobble = Rotation.from_rotvec(rng.normal(0, np.radians(wobble_deg), (n, 3)))
    matrices = np.tile(np.eye(4), (n, 1, 1))
    matrices[:, :3, :3] = (base * wobble * spin).as_matrix()
    matrices[:, :3, 3] = np.array([10, 20, -900]) - matrices[:, :3, :3] @ point
    return matrices


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
    with pytest.raises(NoConsensusError, match=r"only \d+ of 100 poses share a tip within 5 mm"):
        calibrate_pivot(random_poses(np.random.default_rng(0), 100, spread_mm=1e5))


def test_what_cannot_be_a_pivot_is_refused():
    poses = pivoting(np.random.default_rng(0))
    with pytest.raises(InputError, match="has 9 valid poses; a tool calibration needs 10"):
        calibrate_pivot(poses, valid=np.arange(200) < 9)
    poses[17, :3, :3] *= 1.1
    with pytest.raises(InputError, match=r"poses, frame 17: its pose is not rigid \(det R = 1.33\)"):
        calibrate_pivot(poses)


@given(st.integers(0, 10**6))
def test_spin_finds_the_axis(seed):
    found = calibrate_spin(spinning(np.random.default_rng(seed), wobble_deg=0.0))
    assert abs(found.direction @ AXIS) == pytest.approx(1.0, abs=1e-9)
    off = TIP - found.point_mm
    np.testing.assert_allclose(np.cross(off, AXIS), 0, atol=1e-5)
    assert abs(found.point_mm @ AXIS) < 1e-5


def test_spin_covariance_covers_the_truth():
    angles, promised = [], []
    for seed in range(40):
        found = calibrate_spin(spinning(np.random.default_rng(seed), wobble_deg=1.0))
        angles.append(np.linalg.norm(np.cross(found.direction, AXIS)) ** 2)
        promised.append(np.trace(found.covariance))
    assert 0.5 < np.mean(angles) / np.mean(promised) < 2.0


def test_spin_refuses_what_is_none():
    rng = np.random.default_rng(0)
    with pytest.raises(DegenerateGeometryError, match="the tool hardly turned") as caught:
        calibrate_spin(spinning(rng, turn_deg=5.0))
    assert caught.value.code == "still"
    with pytest.raises(DegenerateGeometryError, match="turned about more than one axis") as caught:
        calibrate_spin(pivoting(rng, tilt_deg=60))
    assert caught.value.code == "not-a-spin"


def test_pivot_and_spin_give_the_needle(tmp_path):
    rng = np.random.default_rng(0)
    found = needle_from_axis(calibrate_pivot(pivoting(rng)), calibrate_spin(spinning(rng)), 120.0)
    tip, back = found.line.segment_mm
    assert np.linalg.norm(tip - TIP) < 0.2
    # The marker's origin lies behind the tip: the shaft leads back to it.
    assert np.linalg.norm(back) < np.linalg.norm(tip)
    np.testing.assert_allclose(np.linalg.norm(back - tip), 120)
    assert found.direction_deviation_deg < 0.2
    assert found.diagnostics == ()
    write_lines([found.line], tmp_path / "needle.toml")
    (again,), fixed = read_lines(tmp_path / "needle.toml")
    assert (again.name, again.frame, fixed) == ("needle", "Needle", {})
    assert again.segment_mm.tobytes() == found.line.segment_mm.tobytes()


def test_a_tip_beside_the_axis_is_warned_of():
    rng = np.random.default_rng(0)
    pivot = calibrate_pivot(pivoting(rng, tip=TIP + np.array([5, 0, 0])))
    found = needle_from_axis(pivot, calibrate_spin(spinning(rng)), 120.0)
    assert [d.code for d in found.diagnostics] == ["tip-off-axis"]


def test_needle_from_two_points():
    found = needle_from_points([0, 0, 0], [0, 0, -100], (np.eye(3), np.eye(3)))
    assert found.direction_deviation_deg == pytest.approx(np.degrees(np.sqrt(2) / 100))
    assert [d.code for d in needle_from_points([0, 0, 0], [0, 0, 5]).diagnostics] == ["short-needle"]
    with pytest.raises(DegenerateGeometryError, match="its direction is free"):
        needle_from_points([0, 0, 0], [0, 0, 2], (np.eye(3), np.eye(3)))


def test_a_digitised_point_rests():
    rng = np.random.default_rng(0)
    stylus = pivoting(rng, n=50, noise_mm=0.1)
    found = digitise_point(Poses.of("Stylus", "Needle", stylus), TIP)
    np.testing.assert_allclose(found.point_mm, [100, -50, -1000], atol=0.1)
    stylus[:, :3, 3] += np.linspace(0, 30, 50)[:, None]
    with pytest.raises(DegenerateGeometryError, match="the stylus tip moved by"):
        digitise_point(Poses.of("Stylus", "Needle", stylus), TIP)


@given(
    name=st.text(min_size=1, max_size=20).filter(lambda s: s.isprintable() or "\x7f" in s or "\n" in s),
    numbers=st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6).filter(lambda x: x[:3] != x[3:]),
)
def test_lines_written_are_lines_read(tmp_path_factory, name, numbers):
    path = tmp_path_factory.mktemp("toml") / "lines.toml"
    segment = np.array(numbers).reshape(2, 3)
    write_lines([Line(name, "Needle", segment), Line(name + "2", "Probe", segment)], path)
    again, _ = read_lines(path)
    assert [line.name for line in again] == [name, name + "2"]
    assert again[0].segment_mm.tobytes() == segment.tobytes()


LINE = '[[line]]\nname = "n"\nframe = "Needle"\nfrom_mm = [0, 0, 0]\nto_mm = [0, 0, 1]\n'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "a.toml: has no [[line]] table; write one a needle or wire: name, frame, from_mm, to_mm"),
        (LINE + LINE, "a.toml: two lines are called 'n'; give each its own name"),
        (
            LINE.replace("to_mm", "till"),
            "a.toml, line table 1: lacks to_mm; it needs name, frame, from_mm, to_mm",
        ),
        (
            LINE + "x = 1",
            "a.toml, line table 1: has the unknown key 'x'; known are name, frame, from_mm, to_mm",
        ),
        (
            LINE.replace("0, 1]", "0, 0]"),
            "a.toml, line 'n': has zero length; give two different points of it",
        ),
        (
            LINE.replace("0, 1]", "0, nan]"),
            "a.toml, line table 1: to_mm is three numbers in mm such as [0.0, 0.0, -333.0]; got [0, 0, nan]",
        ),
        (LINE.replace('"n"', "3"), "a.toml, line table 1: name and frame are text in quotes"),
    ],
)
def test_bad_lines_are_refused(tmp_path, text, sentence):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        read_lines(tmp_path / "a.toml")
    assert str(caught.value) == sentence
