"""validate(): which rows were fitted, what is computed; and two calibrations compared."""

import dataclasses

import numpy as np
import pytest
from benchmarks.comparison import SHIFT_MM, shares

import sonocal as sc
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import compare, validate


def scan(seed, count=60, **options):
    simulated = simulate_observations(2, count, seed=seed)
    rows = dataclasses.replace(
        simulated.observations, split=np.where(np.arange(count) < 40, "fit", "test"), sha256="0123"
    )
    return simulated, rows, sc.calibrate(rows, **options)


def codes(validation):
    return [quantity.code for quantity in validation.quantities]


INNER = ["leave-one-frame-out", "repeatability-corners", "repeatability-centre"]


def test_fitted_rows_are_left_out_in_turn_and_the_others_held_out():
    _, rows, found = scan(1, fit_split="fit", test_split="test")
    assert codes(validate(found, rows)) == ["held-out", *INNER]
    _, rows, found = scan(1)
    assert codes(validate(found, rows)) == INNER


def test_another_table_is_held_out_whole():
    _, _, found = scan(1)
    other = simulate_observations(2, 20, seed=2).observations
    assert codes(validate(found, other)) == ["held-out"]
    assert validate(found, other)["held-out"].count == 20


def test_rows_that_were_fitted_are_not_passed_off_as_held_out():
    _, rows, found = scan(1)
    with pytest.raises(sc.InputError, match="all rows of split 'fit' were fitted; name one that was not"):
        validate(found, rows, split="fit")


def test_what_has_no_answer_is_said_and_the_rest_computed():
    _, rows, _ = scan(1)
    rows = dataclasses.replace(rows, target=(np.arange(60) % 2).astype(str))
    found = validate(sc.calibrate(rows), rows)
    assert codes(found) == INNER
    assert [d.code for d in found.diagnostics] == ["not-computed"]
    assert found.diagnostics[0].message.startswith("the leave-one-target-out error was not computed: ")


def test_a_probe_of_the_other_kind_is_refused():
    _, _, found = scan(1)
    with pytest.raises(sc.InputError, match="is of a 3D probe and the calibration of a 2D one"):
        validate(found, simulate_observations(3, 6).observations)


def test_a_number_that_was_not_computed_names_those_that_were():
    _, rows, found = scan(1)
    with pytest.raises(KeyError, match="no 'pra'; there are leave-one-frame-out"):
        validate(found, rows)["pra"]


# Comparison


def test_a_calibration_equals_itself():
    _, _, found = scan(1)
    same = compare(found, found)
    assert same.p_value == pytest.approx(1)
    assert same.shared_input
    assert not same.differ
    np.testing.assert_allclose(same.distance_mm, 0, atol=1e-12)


def test_a_moved_marker_is_more_than_the_uncertainty_and_by_its_shift():
    _, _, found = scan(1)
    moved = dataclasses.replace(
        found,
        probe_from_image=sc.Similarity(
            found.probe_from_image.rotation,
            found.probe_from_image.translation + np.array([0, 0, 5.0]),
            found.probe_from_image.scales[0],
        ),
    )
    result = compare(found, moved)
    np.testing.assert_allclose(result.difference_mm, np.tile([0, 0, 5], (5, 1)), atol=1e-9)
    assert result.differ
    assert result.beyond.all()
    assert result.sentence.startswith("They differ by up to 5.00 mm, at (")


@pytest.mark.parametrize("counts", [(6, 6), (8, 8), (20, 20), (8, 50)])
@pytest.mark.parametrize("dimension", [2, 3])
def test_repeated_scans_are_said_to_differ_as_rarely_as_they_should(dimension, counts):
    # 5 % of 100, and three standard deviations: chi-squared gave 17 % for two scans of 8, and 36 % for 8 and 50.
    share, pairs = shares(range(100), dimension, counts)
    assert pairs == 100
    assert share <= 0.115


def test_a_marker_that_moved_between_two_short_scans_is_seen():
    assert shares(range(50), 2, (8, 8), shift_mm=SHIFT_MM)[0] > 0.9


def test_calibrations_of_different_probes_are_not_compared():
    _, _, found = scan(1)
    other = sc.calibrate(simulate_observations(3, 10).observations)
    with pytest.raises(sc.InputError, match="a 2D and of a 3D probe"):
        compare(found, other)


def test_a_table_of_another_scan_with_the_same_name_and_length_was_not_fitted():
    first, second = (simulate_observations(2, 20, seed=seed).observations for seed in (1, 2))
    one = sc.Observations(first.points_px, first.segments_mm)
    other = sc.Observations(second.points_px, second.segments_mm + 500.0)
    found = validate(sc.calibrate(one), other)
    assert "held-out-rows-far-off" in [finding.code for finding in found.diagnostics]
    assert "held-out-rows-far-off" not in [
        finding.code for finding in validate(sc.calibrate(one), one).diagnostics
    ]
