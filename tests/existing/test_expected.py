"""A matrix beside a calibration of ours: in a disguise it is named, and no image is called flipped; a flip still is."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.existing import Existing, meaning_of
from sonocal.existing.compared import compared
from sonocal.existing.expected import against_expected, agreeing
from sonocal.geometry import Similarity
from sonocal.simulation.scene import simulate_observations
from tests.builders.disguises import DISGUISES, LPS, OF_IMAGES, SIZE, as_read
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 10_000)


def scanned(seed, dimension=2, count=60, noise=1.0, **options):
    """A calibration of simulated rows with their noise, and the truth."""
    made = simulate_observations(dimension, count, seed=seed, sigma_px=noise, sigma_mm=noise)
    rows = dataclasses.replace(made.observations, image_size_px=SIZE if dimension == 2 else None)
    return sc.calibrate(rows, **options), made.probe_from_image.matrix


@pytest.fixture(scope="module")
def ours():
    return scanned(3)


def told(change, form="direct", seed=3):
    """The findings of a calibration that was told to expect its own truth, changed."""
    truth = scanned(seed)[1]
    expected = as_read(change(truth), form)
    found = scanned(seed, expected_rotation=meaning_of(expected.matrix).rotation)[0]
    return against_expected(found, expected).diagnostics


@pytest.mark.parametrize("disguise", sorted(DISGUISES.keys() - OF_IMAGES))
@pytest.mark.parametrize("seed", [3, 4])
def test_a_disguise_of_what_is_expected_is_named_and_nothing_is_flipped(disguise, seed):
    hidden, form, words, _ = DISGUISES[disguise]
    (found,) = told(hidden, form, seed)
    assert (found.code, found.severity) == ("misread-matrix", "info")
    assert words in f"{found.message}: {found.advice}"
    assert found.message.endswith("and the image is the right way round")


@pytest.mark.parametrize("disguise", sorted(OF_IMAGES))
def test_a_matrix_of_images_that_run_otherwise_is_named_and_the_image_still_doubted(disguise):
    hidden, form, words, _ = DISGUISES[disguise]
    doubt, found = told(hidden, form)
    assert (doubt.code, doubt.severity) == (
        "unexpected-orientation" if "exchanged" in disguise else "flipped-image",
        "warning",
    )
    assert (found.code, found.severity) == ("misread-matrix", "info")
    assert words in found.message
    assert found.message.endswith("whose images are the right way round, no residual tells")


@pytest.mark.parametrize("disguise", DISGUISES)
@pytest.mark.parametrize("seed", range(3))
def test_any_disguise_is_undone_to_within_what_ours_is_known_to(disguise, seed):
    calibration, truth = scanned(seed)
    hidden, form, _, name = DISGUISES[disguise]
    beside = compared(as_read(hidden(truth), form), calibration)
    (way,) = beside.rereadings
    assert way.name == name
    np.testing.assert_allclose(way.matrix[:3, [0, 1, 3]], truth[:3, [0, 1, 3]], rtol=0.02, atol=0.02)
    assert beside.difference.distance_mm.max() > 15
    assert beside.difference.reread.distance_mm.max() < 3
    assert way.words in beside.difference.because


@pytest.mark.parametrize("disguise", sorted(DISGUISES.keys() - OF_IMAGES))
def test_beside_a_calibration_of_a_volume_a_disguise_is_named_as_well(disguise):
    calibration, truth = scanned(2, dimension=3)
    hidden, form, _, name = DISGUISES[disguise]
    assert [one.name for one in agreeing(as_read(hidden(truth), form), calibration)] == [name]


@pytest.mark.parametrize("scan", [{"noise": 0.0}, {}, {"dimension": 3}, {"count": 12, "noise": 4.0}])
@pytest.mark.parametrize("seed", range(15))
def test_a_matrix_that_agrees_is_never_accused_however_rough(seed, scan):
    calibration, truth = scanned(seed, **scan)
    rng = np.random.default_rng(seed)
    for off_mm in (0.0, 1.0, 4.0):
        moved = truth.copy()
        moved[:3, 3] += off_mm * rng.normal(size=3) / np.sqrt(3)
        for form in ("direct", "inverse", "slicer"):
            existing = Existing("a.txt", "4 x 4", "", moved, form=form)
            assert agreeing(existing, calibration) == []
            found = set(against_expected(calibration, existing).diagnostics) - set(calibration.diagnostics)
            # Twelve rows of 4 px and 4 mm noise leave mm/px open, and now and then by more than they are known to.
            assert {one.code for one in found} <= ({"expected-scale-differs"} if "count" in scan else set())


@given(seed=seeds)
def test_a_marker_that_was_moved_is_no_disguise(ours, seed):
    assert agreeing(Existing("a.txt", "4 x 4", "", random_similarity(seed, 0.24).matrix), ours[0]) == []


def test_two_ways_that_agree_alike_are_both_said_and_none_is_taken(ours):
    """A marker whose z axis is the image's normal, with the first pixel on it: either side's LPS is the same."""
    matrix = np.array([[0.24, 0, 0, 0], [0, 0.24, 0, 0], [0, 0, 0.24, 80], [0, 0, 0, 1.0]])
    transform = Similarity.from_matrix(matrix)
    calibration = dataclasses.replace(ours[0], probe_from_image=transform)
    beside = compared(Existing("a.txt", "4 x 4", "", LPS @ matrix), calibration)
    assert [one.name for one in beside.rereadings] == ["marker-lps", "image-lps"]
    assert beside.difference.reread is None
    found = against_expected(calibration, Existing("a.txt", "4 x 4", "", LPS @ matrix)).diagnostics[-1]
    assert "has the marker's axes in LPS instead of RAS, or has the image's" in found.message
    assert "(which of them, their agreement does not tell)" in found.message
    assert found.advice.startswith("see which it is: ")


def test_of_a_small_image_what_is_near_is_small(ours):
    """A probe of 12 mm: a matrix that is off by a third of the image is not taken for one that agrees."""
    calibration, truth = ours
    small = dataclasses.replace(calibration, area_px=np.array([[0.0, 0], [40, 30]]), covariance=None)
    moved = truth.copy()
    moved[:3, 3] += (4.0, 0, 0)
    assert agreeing(Existing("a.txt", "4 x 4", "", np.linalg.inv(moved)), small) == []
    assert [one.name for one in agreeing(Existing("a.txt", "4 x 4", "", np.linalg.inv(truth)), small)] == [
        "inverse"
    ]


def test_other_mm_per_px_are_said():
    (found,) = told(lambda m: m @ np.diag([2.0, 2, 2, 1]))
    assert found.code == "expected-scale-differs"
    assert "+1" in found.message or "+9" in found.message
