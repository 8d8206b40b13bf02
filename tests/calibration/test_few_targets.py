"""Two or three wires that keep their places are too few; more, or needles that are moved about, are enough."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.trust_faults import Case
from benchmarks.simulators.trust_judge import calibrated
from benchmarks.simulators.trust_scans import noisy, wires
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal.calibration.few_targets import few_fixed_targets, few_targets_finding
from sonocal.registration.rows import PointLineRows
from sonocal.validation import give_verdict
from tests.builders.point_lines import reordered

seeds = st.integers(0, 10**6)
FRAMES = 12


def rows_of(seed, wires, frames=FRAMES, apart=False):
    """Wires of a phantom that a probe sees in all frames; `apart`: each is moved about by itself."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-60, 60, (wires, 2, 3))
    places[:, 1] += 100 * rng.normal(size=(wires, 3))
    turns = Rotation.random(frames * wires, random_state=seed).as_matrix().reshape(frames, wires, 3, 3)
    shifts = rng.uniform(-100, 100, (frames, wires, 3))
    if not apart:
        turns, shifts = np.repeat(turns[:, :1], wires, axis=1), np.repeat(shifts[:, :1], wires, axis=1)
    segments = (np.einsum("fwij,wkj->fwki", turns, places) + shifts[:, :, None]).reshape(-1, 2, 3)
    points = np.column_stack([rng.uniform(0, 500, (frames * wires, 2)), np.zeros(frames * wires)])
    frame, target = np.repeat(np.arange(frames), wires), np.tile(np.arange(wires), frames)
    return PointLineRows(points, segments, 2, frame=frame.astype(np.int32), target=target.astype(np.int32))


def all_of(rows):
    return np.ones(len(rows), dtype=bool)


@given(seeds, st.integers(1, 6))
def test_wires_of_a_phantom_are_few_below_four_but_for_one(seed, wires):
    rows = rows_of(seed, wires)
    assert few_fixed_targets(rows, all_of(rows)) == (wires if wires in (2, 3) else 0)


@given(seeds, st.integers(1, 6))
def test_needles_that_are_moved_about_are_never_few(seed, needles):
    rows = rows_of(seed, needles, apart=True)
    assert few_fixed_targets(rows, all_of(rows)) == 0


@given(seeds, st.integers(2, 5))
def test_only_rows_that_agree_are_looked_at(seed, wires):
    """Of a phantom of more wires, two or three that agree are few; and two that agree in few frames say nothing."""
    rows = rows_of(seed, wires)
    assert few_fixed_targets(rows, rows.target < 2) == 2
    assert few_fixed_targets(rows, (rows.target < 2) & (rows.frame < 3)) == 0


@given(seeds)
def test_the_order_of_rows_and_the_end_that_a_wire_is_given_from_mean_nothing(seed):
    rows, rng = rows_of(seed, 3), np.random.default_rng(seed)
    mixed = reordered(rows, rng.permutation(len(rows)))
    turned = np.where(rng.random(len(rows))[:, None, None] < 0.5, rows.segments_mm, rows.segments_mm[:, ::-1])
    # A wire that is given by other points of it stays one.
    longer = rows.segments_mm + (rows.segments_mm[:, 1:] - rows.segments_mm[:, :1]) * [[[0.0], [0.5]]]
    for other in (
        mixed,
        *(dataclasses.replace(rows, segments_mm=np.ascontiguousarray(x)) for x in (turned, longer)),
    ):
        assert few_fixed_targets(other, all_of(other)) == 3


@given(seeds, st.floats(0.0, 0.05))
def test_a_trackers_noise_leaves_a_phantom_one_and_a_hand_does_not(seed, sigma_mm):
    rows, rng = rows_of(seed, 2), np.random.default_rng(seed)
    noisy = rows.segments_mm + sigma_mm * rng.normal(size=rows.segments_mm.shape)
    assert few_fixed_targets(dataclasses.replace(rows, segments_mm=noisy), all_of(rows)) == 2
    shaken = rows.segments_mm + 5.0 * rng.normal(size=(len(rows), 1, 3))
    assert few_fixed_targets(dataclasses.replace(rows, segments_mm=shaken), all_of(rows)) == 0


def test_the_finding_says_how_many_and_nothing_of_none():
    assert not list(few_targets_finding(0))
    (found,) = few_targets_finding(3)
    assert found.message.startswith("all rows are of 3 targets that keep")


@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_calibration_to_few_wires_predicts_nothing_and_says_so_once(count):
    case = Case(noisy(wires(1, 60, count), np.random.default_rng(0), 1.0, 0.05))
    found = calibrated(case)
    codes = [one.code for one in found.diagnostics]
    assert codes.count("few-targets") == (count < 4)
    assert (found.covariance is None) == (count < 4)
    assert (give_verdict(found).level == "stop") == (count < 4)
