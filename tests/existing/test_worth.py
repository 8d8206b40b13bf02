"""What a matrix is worth: laws on simulated sightings, and PLUS's own matrices on its own."""

import dataclasses
import json

import numpy as np
import pytest

import sonocal as sc
from sonocal.existing import Existing
from sonocal.existing.difference import difference
from sonocal.existing.worth import Said, worth_of, worth_on_points
from sonocal.geometry import AxisScaled
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import PointSightings, held_out
from tests.builders.similarities import random_similarity

SETS = ["depth15_polaris", "fcal12_ascension", "trus_3nwires"]


def existing(transform):
    return Existing("plus.xml", "PLUS device set", "ImageToProbe", transform.matrix)


def scene(seed=3, count=60, **how):
    made = simulate_observations(2, count, seed=seed, **how)
    return made.observations, made.probe_from_image


def codes(worth):
    return [one.code for one in worth.diagnostics]


@pytest.mark.parametrize("seed", range(4))
def test_a_right_matrix_is_off_by_the_noise_and_within_what_ours_leaves_open(seed):
    rows, truth = scene(seed)
    worth = worth_of(existing(truth), rows)
    theirs, ours = worth.quantities[0], worth.own_quantities[0]
    assert theirs.low_mm < ours.value_mm < theirs.high_mm
    assert theirs.value_mm <= ours.value_mm  # ours has the noise of its fit besides
    assert "worse-than-ours" not in codes(worth)
    assert not worth.difference.beyond.all()
    assert worth.difference.rotation_deg < 2


@pytest.mark.parametrize("seed", range(2))
def test_a_volumes_matrix_is_compared_with_one_scale_whatever_it_has(seed):
    made = simulate_observations(3, 40, seed=seed)
    truth = made.probe_from_image
    right = worth_of(existing(truth), made.observations)
    assert "worse-than-ours" not in codes(right)
    assert len(right.difference.places_px) == 9
    stretched = AxisScaled(truth.rotation, truth.translation, truth.scales * [1.0, 1.05, 1.0])
    worth = worth_of(existing(stretched), made.observations)
    assert worth.own.model == "similarity"
    assert "worse-than-ours" in codes(worth)


MOVED = {
    "moved by 6 mm": (
        lambda t: AxisScaled(t.rotation, t.translation + np.array([4, 4, 2]), t.scales),
        "look for a marker that was moved",
    ),
    "another depth": (
        lambda t: AxisScaled(t.rotation, t.translation, 1.1 * t.scales),
        "its mm/px differ by +",
    ),
}


@pytest.mark.parametrize("how", MOVED)
@pytest.mark.parametrize("seed", range(3))
def test_a_wrong_matrix_is_worse_than_ours_and_what_changed_is_said(how, seed):
    rows, truth = scene(seed)
    change, words = MOVED[how]
    worth = worth_of(existing(change(truth)), rows)
    found = next(one for one in worth.diagnostics if one.code == "worse-than-ours")
    assert words in found.advice
    assert worth.difference.beyond.any()
    assert "more than that leaves open" in worth.sentence


@pytest.mark.parametrize("seed", range(3))
def test_moving_the_marker_moves_everything_with_it_and_changes_no_number(seed):
    rows, truth = scene(seed, 30)
    other = random_similarity(seed + 50, 0.24)
    crooked = AxisScaled(truth.rotation, truth.translation + 3.0, truth.scales)
    moved_rows = dataclasses.replace(
        rows, segments_mm=rows.segments_mm @ other.rotation.T + other.translation, sha256=""
    )
    moved = AxisScaled(
        other.rotation @ crooked.rotation,
        other.rotation @ crooked.translation + other.translation,
        crooked.scales,
    )
    one, two = worth_of(existing(crooked), rows), worth_of(existing(moved), moved_rows)
    assert one.quantities[0].value_mm == pytest.approx(two.quantities[0].value_mm, rel=1e-6)
    assert one.own_quantities[0].value_mm == pytest.approx(two.own_quantities[0].value_mm, rel=1e-3)
    np.testing.assert_allclose(one.difference.distance_mm, two.difference.distance_mm, rtol=1e-2, atol=1e-2)


def test_our_own_matrix_is_not_apart_from_ours():
    rows, _ = scene()
    own = sc.calibrate(rows)
    worth = worth_of(existing(own.probe_from_image), rows, own=own)
    assert worth.own is own
    assert worth.difference.distance_mm.max() < 1e-9
    assert worth.difference.rotation_deg < 1e-6
    assert "no more than that leaves open anywhere" in worth.difference.sentence


def test_a_split_is_measured_by_both_and_fitted_by_neither():
    rows, truth = scene(5)
    rows = dataclasses.replace(rows, split=np.where(np.arange(len(rows)) < 40, "fit", "test"))
    worth = worth_of(existing(truth), rows, split="test")
    fitted = sc.calibrate(rows, test_split="test")
    assert worth.own_quantities[0].value_mm == pytest.approx(fitted.test.rms_mm)
    assert worth.quantities[0].value_mm == pytest.approx(
        held_out(dataclasses.replace(fitted, probe_from_image=truth), rows.select_split("test")).value_mm
    )
    with pytest.raises(sc.InputError, match="split"):
        worth_of(existing(truth), rows, split="nowhere")


def test_outliers_of_the_table_are_counted_for_neither():
    rows, truth = scene(6, outlier_share=0.2)
    worth = worth_of(existing(truth), rows)
    assert worth.quantities[0].count < len(rows)
    assert worth.quantities[0].value_mm < 3


def test_rows_that_allow_no_calibration_still_measure_the_matrix():
    rows, truth = scene(1, 3)
    worth = worth_of(existing(truth), rows)
    assert worth.own is None
    assert worth.difference is None
    assert len(worth.quantities) == 1
    assert codes(worth)[0] == "not-computed"
    assert "there is no calibration of our own to compare with" in worth.diagnostics[0].message


def test_unequal_pixels_are_compared_with_unequal_pixels():
    rows, truth = scene()
    assert worth_of(existing(truth), rows).own.model == "similarity"
    stretched = AxisScaled(truth.rotation, truth.translation, truth.scales * [1.0, 1.05, 1.0])
    assert worth_of(existing(stretched), rows).own.model == "anisotropic"


def test_the_scanners_scale_is_compared_with_the_matrix():
    rows, truth = scene()
    (finding,) = [
        one
        for one in worth_of(existing(truth), rows, said=Said((0.2,), "the scanner")).diagnostics
        if one.code == "scale-differs-from-scanner"
    ]
    assert "0.24000 mm/px along u and the scanner says 0.20000: +20.0 %" in finding.message


CAUSES = {
    (0.24 / 1.05, 0.24 / 1.05): "both axes differ alike",
    (0.24, 0.24 / 0.96): "it is depth alone: sound of another speed",
    (0.24 * 1.1, 0.24 / 1.1): "the axes differ unlike one another",
}


@pytest.mark.parametrize("said", CAUSES)
def test_what_makes_a_scale_differ_is_said_by_how_the_axes_do(said):
    rows, truth = scene()
    worth = worth_of(existing(truth), rows, said=Said(said, "the recording (its header)"))
    (finding,) = [one for one in worth.diagnostics if one.code == "scale-differs-from-scanner"]
    assert CAUSES[said] in finding.advice
    assert "the recording (its header) says" in finding.message
    assert worth.scale_sentence.startswith(
        f"The recording (its header) says {said[0]:.5f} x {said[1]:.5f} mm/px: "
    )


def test_a_scale_that_agrees_is_said_and_is_no_finding():
    rows, truth = scene()
    worth = worth_of(existing(truth), rows, said=Said((0.24,), "the scanner"))
    assert "scale-differs-from-scanner" not in codes(worth)
    assert "this matrix has +0.0 % along u and +0.0 % along v, ours " in worth.scale_sentence
    assert worth_of(existing(truth), rows).scale_sentence == ""


def test_known_points_measure_a_matrix():
    _, truth = scene()
    pixels = np.random.default_rng(0).uniform(0, 500, (12, 2))
    places = truth @ pixels + [0.0, 3.0, 4.0]
    points = PointSightings(
        points_px=pixels, points_mm=places, frame=np.arange(12), target=np.array([""] * 12), source="w.csv"
    )
    worth = worth_on_points(existing(truth), points)
    assert worth.quantities[0].value_mm == pytest.approx(5.0)
    assert worth.own is None
    assert "w.csv, ImageToProbe of plus.xml is off by 5.00 mm" in worth.sentence


def test_without_uncertainty_a_difference_says_only_how_far():
    one, other = (existing(random_similarity(seed, 0.2)) for seed in (1, 2))
    apart = difference(one, other, np.array([[0.0, 0.0], [500.0, 400.0]]))
    assert apart.known_mm is None
    assert apart.beyond is None
    assert apart.sentence.endswith(" px.")
    back = difference(other, one, np.array([[0.0, 0.0], [500.0, 400.0]]))
    np.testing.assert_allclose(apart.difference_mm, -back.difference_mm)
    assert apart.rotation_deg == pytest.approx(back.rotation_deg)


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("split", ["calibration", "validation"])
def test_plus_matrices_have_the_errors_that_plus_reports(data_folder, name, split):
    """To four digits: the matrix is printed with six, the pixels with three decimals."""
    reference = json.loads((data_folder / "observations" / f"{name}.reference.json").read_text())
    rows = sc.read_observations(data_folder / "observations" / f"{name}.csv")
    for one in reference["reference_calibrations"]:
        matrix = Existing("plus.xml", "PLUS device set", "ImageToProbe", np.array(one["image_to_probe"]))
        worth = worth_of(matrix, rows, split=split, nwires=reference["nwires"])
        error = next(q for q in worth.quantities if q.code == "plus-nwire")
        assert error.value_mm == pytest.approx(one["reported"][f"{split.capitalize()}MeanMm"], rel=1e-4)
        # Of the stepper's wires, which are almost parallel, one half alone leaves ours free.
        ours = [] if worth.own is None else ["held-out", "plus-nwire"]
        assert [q.code for q in worth.own_quantities] == ours
        assert worth.own is not None or name == "trus_3nwires"
