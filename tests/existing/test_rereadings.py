"""A true matrix in each usual disguise is named by it, itself never, and what rows do not tell apart is not guessed."""

import dataclasses

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from sonocal.existing import Existing
from sonocal.existing.fitting import fitting, in_words
from sonocal.existing.rereadings import rereadings
from sonocal.existing.worth import Said, worth_of, worth_on_points
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import PointSightings
from tests.builders.disguises import DISGUISES, INVERSE, LPS, OF_IMAGES, SIZE, as_read, flipped
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 10_000)


def rms_mm(matrix, truth):
    places = np.array([[u, v, 0, 1] for u in (0, 300, 639) for v in (0, 200, 479)])
    return np.sqrt(np.mean(np.sum((places @ (matrix - truth)[:3].T) ** 2, axis=1)))


def named(existing, truth, noise_mm=0.5, size=SIZE):
    """What the places of the image say, were they known to the noise: words and advice of each way that fits."""

    def off(matrix):
        return float(np.hypot(rms_mm(matrix, truth), noise_mm))

    scale = np.cbrt(np.linalg.det(truth[:3, :3]))
    ways = rereadings(existing, 2, size, scale)
    found = fitting(ways, off, off(existing.matrix), noise_mm)
    return [f"{one.words}: {one.advice}" for one in found]


@pytest.mark.parametrize("disguise", DISGUISES)
@given(seed=seeds)
def test_a_disguised_matrix_is_named_by_its_disguise(disguise, seed):
    truth = random_similarity(seed, 0.2).matrix
    hidden, form, words, name = DISGUISES[disguise]
    existing = as_read(hidden(truth), form)
    assume(rms_mm(existing.matrix, truth) > 5)  # a rotation may be its own transpose
    assert any(words in found for found in named(existing, truth))
    ways = rereadings(existing, 2, SIZE, 0.2)
    (exact,) = [one for one in ways if rms_mm(one.matrix, truth) < 1e-6 and one.name == name]
    assert exact.of_images == (disguise in OF_IMAGES)


@given(seed=seeds, scale=st.floats(0.02, 0.7), noise=st.floats(0.05, 3))
def test_the_true_matrix_is_never_named_however_it_is_stored(seed, scale, noise):
    truth = random_similarity(seed, scale).matrix
    for form, stored in (("direct", truth), ("inverse", INVERSE(truth))):
        assert named(as_read(stored, form), truth, noise) == []


@given(seed=seeds)
def test_a_marker_that_was_moved_is_no_disguise(seed):
    truth, moved = random_similarity(seed, 0.2).matrix, random_similarity(seed + 1, 0.2).matrix
    assert named(as_read(moved, "direct"), truth) == []


def test_two_ways_that_coincide_are_both_said_and_neither_is_guessed():
    truth = np.array([[0.2, 0, 0, 0], [0, 0.2, 0, 0], [0, 0, 0.2, 80], [0, 0, 0, 1.0]])
    existing = as_read(LPS @ truth, "direct")
    assert len(named(existing, truth)) == 2
    ways = [one for one in rereadings(existing, 2) if np.allclose(one.matrix, truth)]
    words, advice = in_words(ways)
    assert "marker's axes in LPS" in words
    assert "image's axes in LPS" in words
    assert "these rows do not tell" in words
    assert advice.startswith("see which it is: ")


def test_without_the_images_size_nothing_is_called_mirrored():
    truth = random_similarity(3, 0.2).matrix
    assert named(as_read(flipped(0)(truth), "direct"), truth, size=None) == []


@pytest.mark.parametrize("disguise", DISGUISES)
def test_a_scan_names_the_disguise_first_and_blames_nothing_else(disguise):
    made = simulate_observations(2, 60, seed=4)
    rows = dataclasses.replace(made.observations, image_size_px=SIZE)
    hidden, form, words, name = DISGUISES[disguise]
    existing = as_read(hidden(made.probe_from_image.matrix), form)
    worth = worth_of(existing, rows, said=Said((0.24,), "the scanner"))
    assert [one.code for one in worth.diagnostics if one.severity == "warning"] == ["misread-matrix"]
    first = worth.diagnostics[0]
    assert words in f"{first.message}: {first.advice}"
    assert [one.name for one in worth.rereadings] == [name]
    assert worth.sentence.lower() == f"{first.message}: {first.advice}.".lower()
    assert "this matrix, read so, has" in worth.scale_sentence
    np.testing.assert_allclose(
        worth.reread.matrix[:3, [0, 1, 3]], made.probe_from_image.matrix[:3, [0, 1, 3]], rtol=0.02, atol=0.02
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_volume_whose_axes_are_exchanged_is_named(seed):
    made = simulate_observations(3, 40, seed=seed)
    for axes in ((1, 0, 2, 3), (2, 1, 0, 3), (0, 2, 1, 3)):
        matrix = made.probe_from_image.matrix[:, axes]
        worth = worth_of(Existing("a.txt", "4 x 4", "", matrix), made.observations)
        one, other = ("uvw"[i] for i, k in enumerate(axes[:3]) if i != k)
        assert f"{one} and {other} are exchanged" in worth.diagnostics[0].message


# What points alone do not tell: how large the image is, and its mm/px where the matrix has none.
UNTOLD = {
    "u mirrored",
    "v mirrored",
    "half a turn",
    "px for mm",
    "px for mm, as Slicer stores it",
}


def touched(truth, seed, count=12, off_mm=1.0):
    """Points of the image, and where a stylus that is off by as much found them."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform((0, 0), SIZE, (count, 2))
    places = pixels @ truth[:3, :2].T + truth[:3, 3] + rng.normal(size=(count, 3)) * off_mm / np.sqrt(3)
    return PointSightings(pixels, places, source="wire.csv")


@pytest.mark.parametrize("disguise", sorted(DISGUISES.keys() - UNTOLD))
@pytest.mark.parametrize("seed", range(3))
def test_points_that_are_known_name_a_disguise(disguise, seed):
    truth = random_similarity(seed, 0.2).matrix
    hidden, form, words, name = DISGUISES[disguise]
    worth = worth_on_points(as_read(hidden(truth), form), touched(truth, seed))
    assert name in [one.name for one in worth.rereadings]
    assert words in worth.sentence
    assert worth.diagnostics[0].code == "misread-matrix"
    if worth.reread is not None:
        assert [one.title for one in worth.reread_quantities] == ["PRA, cross-wire, read so"]
        assert worth.reread_quantities[0].value_mm < 2


@pytest.mark.parametrize("seed", range(50))
def test_points_never_accuse_a_matrix_that_is_true_however_rough_they_are(seed):
    truth = random_similarity(seed, 0.2).matrix
    for off_mm in (0.0, 1.0, 4.0):
        worth = worth_on_points(as_read(truth, "direct"), touched(truth, seed, off_mm=off_mm))
        assert worth.rereadings == ()
        assert worth.diagnostics == ()


@given(seed=seeds)
def test_points_name_nothing_of_a_marker_that_was_moved_nor_do_three_of_them(seed):
    truth, moved = random_similarity(seed, 0.2).matrix, random_similarity(seed + 1, 0.2).matrix
    assert worth_on_points(as_read(moved, "direct"), touched(truth, seed)).rereadings == ()
    inverse = as_read(INVERSE(truth), "direct")
    assert worth_on_points(inverse, touched(truth, seed, count=3)).rereadings == ()
