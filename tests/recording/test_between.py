"""Frames cancel: poses between any two tools of a recording are a groupoid, whatever the recording keeps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal import InputError
from sonocal.recording import Poses, Recording
from sonocal.recording.poses import by_name, poses_from_quaternions, rigidity_error
from tests.builders.motion import random_pose, random_twist, recording_of
from tests.builders.recordings import random_poses, random_recording

seeds = st.integers(0, 10_000)
FRAMES = ("Probe", "Needle", "Reference", "Tracker")
TIMES = np.arange(6) * 0.1
frames = st.sampled_from(FRAMES)


def room(seed):
    return recording_of({name: random_twist([seed, k]) for k, name in enumerate(FRAMES[:3])}, TIMES)


def by_hand(seed, target, source):
    """target_from_source from the motions themselves."""

    def of(name):
        at = FRAMES.index(name)
        return (
            random_twist([seed, at])(TIMES) if name != "Tracker" else np.tile(np.eye(4), (len(TIMES), 1, 1))
        )

    return np.linalg.inv(of(target)) @ of(source)


@given(seeds, frames, frames)
def test_between_two_frames_is_what_their_motions_say(seed, target, source):
    found = room(seed).between(target, source)
    assert found.valid.all()
    np.testing.assert_allclose(found.matrices, by_hand(seed, target, source), atol=1e-9)
    assert found.name == f"{target.lower()}_from_{source.lower()}"


@given(seeds, frames, frames, frames)
def test_the_frame_in_the_middle_cancels(seed, a, b, c):
    recording = room(seed)
    through = recording.between(a, b).matrices @ recording.between(b, c).matrices
    np.testing.assert_allclose(through, recording.between(a, c).matrices, atol=1e-8)


@given(seeds, frames, frames)
def test_there_and_back_is_the_inverse(seed, a, b):
    recording = room(seed)
    there, back = recording.between(a, b), recording.between(b, a)
    np.testing.assert_allclose(there.inverse().matrices, back.matrices, atol=1e-8)
    assert there.inverse().name == back.name
    np.testing.assert_array_equal(there.valid, back.valid)


@given(seeds, frames)
def test_a_frame_is_where_it_is(seed, a):
    np.testing.assert_allclose(room(seed).between(a, a).matrices, np.tile(np.eye(4), (6, 1, 1)), atol=1e-12)


@given(seeds, frames, frames)
def test_moving_the_tracker_moves_no_tool_against_another(seed, a, b):
    if "Tracker" in (a, b):
        return
    recording, mover = room(seed), random_pose([seed, 9])
    moved = Recording(
        times=recording.times,
        poses={n: Poses.of(p.source, p.target, mover @ p.matrices) for n, p in recording.poses.items()},
    )
    np.testing.assert_allclose(moved.between(a, b).matrices, recording.between(a, b).matrices, atol=1e-8)


@given(seeds, frames, st.sampled_from(["phantom", "PHANTOM", "Phantom"]))
def test_a_fixed_pose_is_one_more_link_whichever_way_it_is_given_and_spelt(seed, target, spelling):
    recording, place = room(seed), random_pose([seed, 9])
    forwards = recording.between(target, spelling, fixed={("Reference", "Phantom"): place})
    backwards = recording.between(target, spelling, fixed={("Phantom", "Reference"): np.linalg.inv(place)})
    expected = recording.between(target, "Reference").matrices @ place
    np.testing.assert_allclose(forwards.matrices, expected, atol=1e-9)
    np.testing.assert_allclose(backwards.matrices, expected, atol=1e-8)


@given(seeds, frames, frames)
def test_an_item_holds_where_every_pose_of_the_chain_does(seed, a, b):
    recording, rng = room(seed), np.random.default_rng(seed)
    masks = {p.source: rng.random(6) < 0.6 for p in recording.poses.values()}
    poses = {n: Poses(p.source, p.target, p.matrices, masks[p.source]) for n, p in recording.poses.items()}
    found = Recording(times=TIMES, poses=poses).between(a, b)
    all_hold = np.ones(6, dtype=bool)
    for name in {a, b} - {"Tracker"} if a != b else set():
        all_hold &= masks[name]
    np.testing.assert_array_equal(found.valid, all_hold)
    np.testing.assert_array_equal(np.isnan(found.matrices).any(axis=(1, 2)), ~all_hold)


@given(seeds, st.lists(st.integers(0, 5), min_size=1, max_size=6), frames, frames)
def test_choosing_items_first_or_last_is_the_same(seed, rows, a, b):
    recording = room(seed)
    np.testing.assert_array_equal(
        recording.select(rows).between(a, b).matrices, recording.between(a, b).select(rows).matrices
    )


@given(seeds)
def test_poses_of_the_image_are_no_way_from_tool_to_tool(seed):
    """A calibration that a file holds is what is asked for, not what answers."""
    recording = room(seed)
    image = Poses.of("Image", "Probe", random_poses(np.random.default_rng(seed), 6))
    with_image = Recording(times=TIMES, poses={**recording.poses, image.name: image})
    with pytest.raises(InputError, match="nothing connects Image to Tracker"):
        with_image.between("Tracker", "Image")


def test_a_tool_is_found_whatever_its_case_and_refused_where_there_is_none_or_two():
    recording = random_recording(0)
    assert recording.tool("pRoBe") is recording.poses["tracker_from_probe"]
    with pytest.raises(
        InputError, match="has no transforms of Stylus; the transforms in it are ProbeToTracker"
    ):
        recording.tool("Stylus")
    other = Poses.of("Probe", "Reference", random_poses(np.random.default_rng(1), 5))
    twice = Recording(times=recording.times, poses={**recording.poses, other.name: other})
    with pytest.raises(InputError, match="has several transforms of Probe"):
        twice.tool("Probe")
    assert twice.tool("Probe", "Reference") is other


def test_transforms_that_differ_in_spelling_alone_are_one_twice():
    matrices = random_poses(np.random.default_rng(0), 2)
    one, other = Poses.of("MyProbe", "Tracker", matrices), Poses.of("my_probe", "Tracker", matrices)
    assert one.name == other.name
    with pytest.raises(InputError, match="rename one"):
        by_name([one, other], "a.mha")


@given(seeds)
def test_quaternions_give_scipys_rotations_whatever_their_sign_and_small_errors_of_length(seed):
    rng = np.random.default_rng(seed)
    rotations, places = Rotation.random(7, random_state=rng), rng.normal(size=(7, 3)) * 100
    wxyz = np.roll(rotations.as_quat(), 1, axis=1)
    signs, lengths = rng.choice([-1, 1], (7, 1)), 1 + rng.uniform(-0.009, 0.009, (7, 1))
    found = poses_from_quaternions(signs * lengths * wxyz, places, "Probe", "Tracker", "a.csv")
    assert found.valid.all()
    np.testing.assert_allclose(found.matrices[:, :3, :3], rotations.as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(found.matrices[:, :3, 3], places)
    assert rigidity_error(found.matrices).max() < 1e-12


@given(seeds, st.integers(0, 6), st.integers(0, 6))
def test_a_row_with_a_hole_is_no_pose_and_spoils_no_other(seed, row, column):
    rng = np.random.default_rng(seed)
    wxyz, places = np.roll(Rotation.random(7, random_state=rng).as_quat(), 1, axis=1), rng.normal(size=(7, 3))
    whole = poses_from_quaternions(wxyz, places, "Probe", "Tracker", "a.csv")
    numbers = np.hstack([wxyz, places])
    numbers[row, column] = np.nan
    found = poses_from_quaternions(numbers[:, :4], numbers[:, 4:], "Probe", "Tracker", "a.csv")
    others = np.arange(7) != row
    np.testing.assert_array_equal(found.valid, others)
    np.testing.assert_array_equal(found.matrices[others], whole.matrices[others])


@given(seeds, st.integers(0, 6), st.sampled_from([0.5, 0.98, 1.02, 57.3]))
def test_a_quaternion_far_from_unit_length_is_refused_with_its_row(seed, row, length):
    wxyz = np.roll(Rotation.random(7, random_state=seed).as_quat(), 1, axis=1)
    wxyz[row] *= length
    with pytest.raises(InputError) as caught:
        poses_from_quaternions(wxyz, np.zeros((7, 3)), "Probe", "Tracker", "a.csv")
    assert str(caught.value).startswith(f"a.csv, row {row}: the quaternion of Probe has length {length:.3g} ")


@given(seeds, st.floats(0.5, 2.0))
def test_how_far_a_matrix_is_from_rigid_is_how_far_its_scale_squared_is_from_one(seed, scale):
    poses = random_poses(np.random.default_rng(seed), 4)
    poses[:, :3, :3] *= scale
    np.testing.assert_allclose(rigidity_error(poses), abs(scale**2 - 1), atol=1e-12)
    poses[:, :3, 0] *= -1
    assert np.all(np.isinf(rigidity_error(poses)))
    poses[1, 0, 0] = np.nan
    assert np.isnan(rigidity_error(poses)[1])


@given(seeds, st.sets(st.integers(0, 5), min_size=1))
def test_bent_poses_are_refused_with_the_first_of_them_or_skipped_alone(seed, bent):
    recording = room(seed)
    matrices = recording.poses["tracker_from_probe"].matrices.copy()
    matrices[list(bent), :3, :3] *= 1.05
    spoilt = Recording(times=TIMES, poses={"tracker_from_probe": Poses.of("Probe", "Tracker", matrices)})
    with pytest.raises(InputError, match=f"frame {min(bent)}: ProbeToTracker is not rigid"):
        spoilt.between("Tracker", "Probe")
    assert set(np.flatnonzero(~spoilt.between("Tracker", "Probe", on_invalid="skip").valid)) == bent
