"""Poses at other times, and two clocks: steady motion is met exactly, and shifts come out as they went in."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal import InputError
from sonocal.recording import (
    Poses,
    Recording,
    estimate_latency,
    health,
    interpolate_poses,
    join,
    motion_signal,
    with_latency,
)
from sonocal.recording.signals import bottom_line, bottom_line_signal
from tests.builders.motion import random_pose, random_twist, random_wave, recording_of
from tests.builders.recordings import random_poses

seeds = st.integers(0, 10_000)
STEP_S = 0.05


def stamps(seed, count=20):
    return np.cumsum(np.random.default_rng([seed, 1]).uniform(0.01, 0.15, count))


def poses_of(matrices):
    return Poses.of("Probe", "Tracker", matrices)


def within(seed, times, count=15):
    return np.random.default_rng([seed, 2]).uniform(times[0], times[-1], count)


@given(seeds)
def test_a_steady_motion_is_met_exactly_at_every_time(seed):
    twist, times = random_twist(seed), stamps(seed)
    at = within(seed, times)
    found = interpolate_poses(poses_of(twist(times)), times, at)
    assert found.valid.all()
    np.testing.assert_allclose(found.matrices, twist(at), atol=1e-9)


@given(seeds)
def test_poses_between_poses_are_rigid(seed):
    times = stamps(seed)
    found = interpolate_poses(
        poses_of(random_poses(np.random.default_rng(seed), 20)), times, within(seed, times)
    )
    rotation = found.matrices[:, :3, :3]
    np.testing.assert_allclose(
        np.swapaxes(rotation, 1, 2) @ rotation, np.tile(np.eye(3), (15, 1, 1)), atol=1e-12
    )
    assert np.all(np.linalg.det(rotation) > 0)


@given(seeds, st.floats(-1e3, 1e3), st.floats(0.1, 1.9))
def test_a_clock_that_starts_elsewhere_or_runs_at_another_rate_changes_no_pose(seed, offset, rate):
    poses, times = poses_of(random_poses(np.random.default_rng(seed), 20)), stamps(seed)
    at = within(seed, times)
    expected = interpolate_poses(poses, times, at, max_gap_s=10)
    found = interpolate_poses(poses, offset + rate * times, offset + rate * at, max_gap_s=10)
    np.testing.assert_allclose(found.matrices, expected.matrices, atol=1e-6)


@given(seeds)
def test_moving_the_tracker_moves_poses_between_poses_with_it(seed):
    matrices, times, mover = random_poses(np.random.default_rng(seed), 20), stamps(seed), random_pose(seed)
    at = within(seed, times)
    moved = interpolate_poses(poses_of(mover @ matrices), times, at).matrices
    np.testing.assert_allclose(
        moved, mover @ interpolate_poses(poses_of(matrices), times, at).matrices, atol=1e-8
    )


@given(seeds)
def test_time_backwards_gives_the_same_poses_backwards(seed):
    matrices, times = random_poses(np.random.default_rng(seed), 20), stamps(seed)
    at = within(seed, times)
    forwards = interpolate_poses(poses_of(matrices), times, at).matrices
    backwards = interpolate_poses(poses_of(matrices[::-1]), -times[::-1], -at).matrices
    np.testing.assert_allclose(backwards, forwards, atol=1e-9)


@given(seeds)
def test_a_pose_put_in_where_it_was_interpolated_changes_nothing(seed):
    matrices, times = random_poses(np.random.default_rng(seed), 20), stamps(seed)
    at = within(seed, times)
    expected = interpolate_poses(poses_of(matrices), times, at)
    more = np.sort(np.append(times, at[0]))
    denser = interpolate_poses(poses_of(matrices), times, more)
    again = interpolate_poses(denser, more, at)
    np.testing.assert_allclose(again.matrices, expected.matrices, atol=1e-8)


@given(seeds, st.floats(0.02, 0.2))
def test_a_pose_is_there_exactly_where_two_sound_ones_close_enough_bracket_it(seed, gap):
    rng, times = np.random.default_rng(seed), stamps(seed)
    valid = rng.random(20) < 0.7
    poses = Poses("Probe", "Tracker", random_poses(rng, 20), valid)
    at = np.sort(rng.uniform(times[0] - 0.1, times[-1] + 0.1, 60))
    found = interpolate_poses(poses, times, at, max_gap_s=gap)
    for time, holds in zip(at, found.valid, strict=True):
        before, after = np.searchsorted(times, time) - 1, np.searchsorted(times, time)
        bracketed = before >= 0 and after < 20 and valid[before] and valid[after]
        assert holds == (bracketed and times[after] - times[before] <= gap)


@given(seeds, st.integers(-4, 4))
def test_a_latency_there_and_back_is_none(seed, steps):
    """Steps of the recording's own, so that poses come from poses and nothing is lost but the ends."""
    times = np.arange(20) * 0.125
    recording = recording_of({"Probe": random_twist(seed)}, times)
    moved = with_latency(recording, steps * 0.125)
    # As a recording of its own, that says nothing of having been moved.
    there = Recording(times=moved.times, frames=moved.frames, image=moved.image, poses=moved.poses)
    back = with_latency(there, -steps * 0.125).poses["tracker_from_probe"]
    kept = slice(abs(steps), 20 - abs(steps))
    assert back.valid[kept].all()
    assert back.valid.sum() >= 20 - 2 * abs(steps)
    np.testing.assert_array_equal(back.matrices[kept], recording.poses["tracker_from_probe"].matrices[kept])


@given(seeds, st.floats(-0.3, 0.3))
def test_a_latency_takes_every_pose_from_where_it_belongs_and_touches_no_image(seed, latency):
    twist, times = random_twist(seed), np.arange(20) * STEP_S
    recording = recording_of({"Probe": twist}, times)
    found = with_latency(recording, latency)
    poses = found.poses["tracker_from_probe"]
    np.testing.assert_allclose(poses.matrices[poses.valid], twist(times + latency)[poses.valid], atol=1e-8)
    assert poses.valid.sum() >= 20 - abs(latency) / STEP_S - 1
    assert found.frames is recording.frames
    assert found.times is recording.times


@given(seeds, st.floats(-0.2, 0.2))
def test_images_joined_to_a_tracker_have_the_poses_of_their_instants(seed, latency):
    rng, twist = np.random.default_rng(seed), random_twist(seed)
    image_times = np.sort(rng.uniform(0.5, 2.0, 12))
    images = recording_of({}, image_times)
    tracker = recording_of({"Probe": twist}, np.arange(0, 2.6, STEP_S), images=False)
    joined = join(images, tracker, latency)
    assert joined.poses["tracker_from_probe"].valid.all()
    np.testing.assert_allclose(
        joined.poses["tracker_from_probe"].matrices, twist(image_times + latency), atol=1e-9
    )


def lag_of(seed, latency, *, scale=1.0, offset=0.0, start=0.0, noise=0.005):
    """The lag found between two samplings of one wave, each with noise."""
    rng, wave = np.random.default_rng([seed, 5]), random_wave(seed)
    image_times = np.sort(rng.uniform(2, 18, 150))
    tracker_times = np.arange(0, 20, 0.02)
    image = scale * (wave(image_times) + noise * rng.normal(size=150)) + offset
    tracker = wave(tracker_times - latency) + noise * rng.normal(size=len(tracker_times))
    return estimate_latency(image_times + start, image, tracker_times + start, tracker)


@given(seeds, st.floats(0.01, 0.3))
def test_a_tracker_ahead_by_as_much_as_another_is_behind_has_the_opposite_lag(seed, latency):
    behind, ahead = lag_of(seed, latency), lag_of(seed, -latency)
    assert behind.latency_s > 0 > ahead.latency_s
    for found, expected in ((behind, latency), (ahead, -latency)):
        assert abs(found.latency_s - expected) < max(5 * found.deviation_s, 2e-3)


@settings(max_examples=10)
@given(seeds, st.floats(-0.2, 0.2), st.sampled_from([-250.0, -1.0, 1e-3, 4.0]), st.floats(-1e3, 1e3))
def test_units_offset_and_sign_of_a_signal_do_not_move_the_lag(seed, latency, scale, offset):
    plain, other = lag_of(seed, latency), lag_of(seed, latency, scale=scale, offset=offset)
    assert other.latency_s == pytest.approx(plain.latency_s, abs=1e-6)
    assert other.correlation == pytest.approx(plain.correlation, abs=1e-6)


@settings(max_examples=10)
@given(seeds, st.floats(-0.2, 0.2), st.sampled_from([-1e3, 1.6e9]))
def test_where_both_clocks_start_does_not_move_the_lag(seed, latency, start):
    assert lag_of(seed, latency, start=start).latency_s == pytest.approx(
        lag_of(seed, latency).latency_s, abs=1e-4
    )


@settings(max_examples=10)
@given(seeds)
def test_more_noise_makes_the_lag_less_certain(seed):
    quiet, loud = lag_of(seed, 0.1, noise=0.01), lag_of(seed, 0.1, noise=0.3)
    assert loud.deviation_s > quiet.deviation_s
    assert loud.correlation < quiet.correlation


@settings(max_examples=10)
@given(seeds)
def test_samples_out_of_order_and_holes_do_not_move_the_lag(seed):
    wave, rng = random_wave(seed), np.random.default_rng(seed)
    t, s = np.arange(0, 20, 0.05), np.arange(0, 20, 0.02)
    expected = estimate_latency(t, wave(t), s, wave(s - 0.1)).latency_s
    order = rng.permutation(len(t))
    holes = np.concatenate([t, [5.0, np.nan]]), np.concatenate([wave(t), [np.nan, 3.0]])
    assert estimate_latency(t[order], wave(t[order]), s, wave(s - 0.1)).latency_s == expected
    assert estimate_latency(*holes, s, wave(s - 0.1)).latency_s == expected


@given(seeds)
def test_the_motion_of_a_tool_is_its_way_along_the_line_it_moves_on(seed):
    rng, wave, times = np.random.default_rng(seed), random_wave(seed), np.arange(60) * STEP_S
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    matrices = random_poses(rng, 60)
    matrices[:, :3, 3] = rng.uniform(-100, 100, 3) + 30 * wave(times)[:, None] * direction
    valid = rng.random(60) < 0.8
    signal = motion_signal(Poses("Probe", "Tracker", matrices, valid))
    np.testing.assert_array_equal(np.isnan(signal), ~valid)
    expected = 30 * (wave(times) - wave(times)[valid].mean())[valid]
    np.testing.assert_allclose(np.abs(signal[valid]), np.abs(expected), atol=1e-8)


def tank(row, gain=1.0, size=(64, 48), width=1.5):
    """An image of a tank's bottom: a bright line of Gaussian profile at a row."""
    profile = 200 * np.exp(-0.5 * ((np.arange(size[0]) - row) / width) ** 2)
    return gain * np.repeat(profile[:, None], size[1], axis=1).astype(np.float32)


@given(st.floats(12, 50), st.floats(0.1, 5.0))
def test_the_bottom_of_a_tank_is_found_between_rows_whatever_the_gain(row, gain):
    assert bottom_line(tank(row, gain)) == pytest.approx(row, abs=0.02)
    assert bottom_line(np.repeat(tank(row, gain)[..., None], 3, axis=-1)) == pytest.approx(row, abs=0.02)


@given(st.floats(17, 50), seeds)
def test_a_reflection_over_a_few_columns_does_not_move_the_bottom(row, seed):
    image, rng = tank(row), np.random.default_rng(seed)
    start = int(rng.integers(0, 40))
    image[2:5, start : start + 5] = 1000
    assert abs(bottom_line(image) - row) < 0.5


def test_a_black_image_has_no_bottom_and_hides_no_other():
    signal = bottom_line_signal([tank(20), np.zeros((64, 48)), tank(30)])
    assert np.isnan(signal).tolist() == [False, True, False]
    np.testing.assert_allclose(signal[[0, 2]], [20, 30], atol=0.02)


@pytest.mark.parametrize("at", [0, 7, 19])
def test_a_time_line_with_a_hole_or_a_repetition_is_refused(at):
    poses, times = poses_of(random_poses(np.random.default_rng(0), 20)), np.arange(20) * STEP_S
    with pytest.raises(InputError, match="has no times"):
        interpolate_poses(poses, np.where(np.arange(20) == at, np.nan, times), [0.1])
    repeated = times.copy()
    repeated[max(at, 1)] = repeated[max(at, 1) - 1]
    with pytest.raises(InputError, match=f"frame {max(at, 1)}: its stamp .* is not later"):
        interpolate_poses(poses, repeated, [0.1])


@settings(max_examples=10)
@given(seeds, st.floats(-0.2, 0.2))
def test_without_noise_the_lag_is_met_to_a_small_part_of_its_grid(seed, latency):
    wave, t, s = random_wave(seed), np.arange(1, 19, 0.05), np.arange(0, 20, 0.002)
    found = estimate_latency(t, wave(t), s, wave(s - latency))
    assert found.latency_s == pytest.approx(latency, abs=3e-5)
    assert found.correlation == pytest.approx(1, abs=1e-5)


def test_a_latency_beyond_the_recording_is_said_to_be_in_seconds():
    recording = recording_of({"Probe": random_twist(1)}, np.arange(20) * 0.125)
    with pytest.raises(
        InputError, match=r"they do not overlap after a latency of 65 s, which is in seconds; bring"
    ):
        with_latency(recording, 65)


def test_poses_that_a_latency_takes_out_of_the_recording_are_not_blamed_on_the_trackers_view():
    recording = recording_of({"Probe": random_twist(1)}, np.arange(20) * 0.125)
    (found,) = [one for one in health(with_latency(recording, 1.25)) if one.code == "invalid-poses"]
    assert (
        "10 of 20 poses are invalid (50 %), 10 in a row at most, 10 of them since the latency takes"
        in found.message
    )
    assert found.advice == "such frames are left out; the latency is in seconds: check it"
