"""The lag that is fitted beside the transform: laws of its value, of its interval, and of when it is refused."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.late import late_scan
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal.calibration import point_line_rows
from sonocal.calibration.lagged import lag_of_rows
from sonocal.calibration.options import Options
from sonocal.errors import DegenerateGeometryError, InputError
from sonocal.observations.velocities import with_velocities
from sonocal.setup_checks.moving_lines import (
    MovingLines,
    line_velocities,
    moving_in_table,
    velocities_in_recording,
)

seeds = st.integers(0, 1000)
lags = st.floats(0.05, 0.19).flatmap(lambda lag: st.sampled_from([lag, -lag]))


def lag_in(rows):
    return lag_of_rows(moving_in_table(rows, point_line_rows(rows)), Options(), "scan")


def restamped(rows, stamps):
    return dataclasses.replace(rows, extra={"time_s": stamps.astype(str)})


def stamps_of(rows):
    return rows.extra["time_s"].astype(float)


@settings(max_examples=8)
@given(seeds, lags)
def test_the_lag_put_in_is_found_to_a_few_of_its_deviations(seed, lag):
    found = lag_in(late_scan(seed, "usual", lag, frames=300).observations)
    assert abs(found.latency_s - lag) < 5 * found.deviation_s
    assert found.deviation_s < 0.002


@settings(max_examples=5)
@given(seeds, lags)
def test_time_turned_round_turns_the_lag_round(seed, lag):
    rows = late_scan(seed, "usual", lag, frames=240).observations
    one, other = lag_in(rows), lag_in(restamped(rows, -stamps_of(rows)))
    assert other.latency_s == pytest.approx(-one.latency_s, abs=1e-5)
    assert other.half_width_s == pytest.approx(one.half_width_s, rel=0.1)


@settings(max_examples=5)
@given(seeds, st.floats(-1e3, 1e3))
def test_when_the_clock_started_changes_no_lag(seed, start):
    rows = late_scan(seed, "usual", 0.12, frames=240).observations
    one, other = lag_in(rows), lag_in(restamped(rows, stamps_of(rows) + start))
    assert other.latency_s == pytest.approx(one.latency_s, abs=1e-5)


@settings(max_examples=5)
@given(seeds, st.floats(0.3, 3.0))
def test_how_large_pixels_are_changes_no_lag(seed, factor):
    rows = late_scan(seed, "usual", 0.12, frames=240).observations
    one = lag_in(rows)
    other = lag_in(dataclasses.replace(rows, points_px=rows.points_px * factor))
    assert other.latency_s == pytest.approx(one.latency_s, abs=1e-5)
    assert other.half_width_s == pytest.approx(one.half_width_s, rel=1e-3)


@settings(max_examples=5)
@given(seeds, st.floats(-0.1, 0.1))
def test_lines_moved_by_their_velocities_move_the_lag_by_as_much_and_nothing_else(seed, shift):
    scan = late_scan(seed, "usual", 0.05, frames=240)
    rows = with_velocities(scan.observations.with_sound(extra={}), scan.velocities)
    moved = rows.with_sound(segments_mm=rows.segments_mm - shift * scan.velocities)
    one, other = lag_in(rows), lag_in(moved)
    assert other.latency_s - one.latency_s == pytest.approx(shift, abs=1e-5)
    assert other.half_width_s == pytest.approx(one.half_width_s, rel=1e-3)
    np.testing.assert_allclose(other.fit.transform.matrix, one.fit.transform.matrix, atol=1e-4)


@pytest.mark.parametrize("memory", [0.0, 0.95])
def test_the_interval_holds_the_truth_though_errors_go_together(memory):
    held = 0
    for seed in range(20):
        low, high = lag_in(late_scan(seed, "usual", 0.1, frames=300, memory=memory).observations).interval_s
        held += low <= 0.1 <= high
    assert held >= 17  # of 20 at 95 %, fewer once in two hundred


def test_needles_that_rest_tell_no_lag():
    scan = late_scan(0, "slow", frames=200)
    still = dataclasses.replace(
        scan.observations,
        points_px=scan.observations.points_px + np.random.default_rng(0).normal(size=(200, 2)),
    )
    with pytest.raises(DegenerateGeometryError, match=r"tells no lag|tells the lag to") as caught:
        lag_in(with_velocities(still.with_sound(extra={}), 0.0 * scan.velocities))
    assert caught.value.code == "lag-untold"
    assert "move the needle" in str(caught.value)


def test_one_velocity_throughout_is_a_shift_of_the_transform_and_tells_no_lag():
    scan = late_scan(0, "usual", frames=200)
    steady = np.broadcast_to([20.0, -10.0, 30.0], scan.velocities.shape)
    with pytest.raises(DegenerateGeometryError, match="alike throughout"):
        lag_in(with_velocities(scan.observations.with_sound(extra={}), steady))


def test_a_table_without_times_and_velocities_is_refused():
    rows = late_scan(0, "usual").observations.with_sound(extra={})
    with pytest.raises(InputError, match=r"needs the column time_s, or the lines' velocities vx0_mm_s"):
        lag_in(rows)


def test_a_parabola_has_the_velocities_that_it_has():
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.5, 1.5, 60)) / 20
    a, b, c = rng.normal(size=(3, 2, 3))
    places = a + time[:, None, None] * b + time[:, None, None] ** 2 * c
    velocities, unrest = line_velocities(np.zeros(60, dtype=int), time, places)
    np.testing.assert_allclose(velocities, b + 2 * time[:, None, None] * c, atol=1e-8)
    assert (unrest >= 0).all()


def test_the_noise_of_velocities_is_what_is_said_of_it():
    rng = np.random.default_rng(1)
    time = np.arange(4000) / 20
    velocities, unrest = line_velocities(
        np.zeros(4000, dtype=int), time, 0.5 * rng.normal(size=(4000, 2, 3)) + [[[0, 0, 0], [0, 0, 300]]]
    )
    assert np.mean(velocities**2) == pytest.approx(np.mean(unrest), rel=0.1)


def test_lines_move_without_a_jump_and_are_where_they_were_seen():
    rng = np.random.default_rng(2)
    time, places = (
        np.arange(40) / 20,
        np.cumsum(rng.normal(size=(40, 2, 3)), axis=0) + np.array([[0, 0, 0], [0, 0, 99]]),
    )
    track = np.zeros(40, dtype=int)
    lines = MovingLines.of(track, time, places)
    np.testing.assert_allclose(lines.at(track, time).spanning_mm, places, atol=1e-9)
    before, after = (lines.at(track, time + shift).spanning_mm for shift in (-1e-9, 1e-9))
    np.testing.assert_allclose(before, after, atol=1e-5)
    far = lines.at(np.zeros(2, dtype=int), np.array([-1.0, 5.0]))
    assert not far.usable.any()


def test_in_a_recording_lines_have_velocities_where_they_have_places():
    scan = late_scan(0, "usual", frames=100)
    segments = scan.observations.segments_mm[:, None].copy()
    segments[40:50] = np.nan
    found = velocities_in_recording(scan.recording.times, segments)
    np.testing.assert_array_equal(
        np.isfinite(found).all(axis=(1, 2, 3)), np.isfinite(segments).all(axis=(1, 2, 3))
    )
    known = np.isfinite(found).all(axis=(1, 2, 3))
    off = found[known, 0] - scan.velocities[known]
    assert np.sqrt(np.mean(off**2)) < 0.3 * np.sqrt(np.mean(scan.velocities**2))
