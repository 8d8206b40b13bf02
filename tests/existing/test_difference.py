"""Two matrices apart: all places are judged at once, and the sentence quotes the place that it concludes from."""

import numpy as np
import pytest

from sonocal.existing.difference import Difference
from sonocal.registration.uncertainty import radius_95

PLACES = np.array([[0.0, 0], [9, 0], [0, 9], [9, 9], [4.5, 4.5]])


def apart(distances, known):
    difference = np.zeros((5, 3))
    difference[:, 0] = distances
    return Difference("ours", PLACES, difference, np.array(known), 0.0, np.ones(3), np.ones(3))


def test_the_place_quoted_is_the_one_that_shows_it():
    one = apart([3.0, 1, 2, 1, 1], [4.0, 4, 1, 4, 4])
    assert "up to 3.00 mm apart; at (0, 9) px 2.00 mm, where ours is known to 1.00 mm" in one.sentence
    assert one.sentence.endswith(": more than that leaves open.")


@pytest.mark.parametrize("seed", range(20))
def test_the_sentence_never_contradicts_its_own_numbers(seed):
    random = np.random.default_rng(seed)
    one = apart(random.uniform(0, 2, 5), random.uniform(1, 3, 5))
    worst = np.argmax(one.distance_mm / one.known_mm)
    assert f"known to {one.known_mm[worst]:.2f} mm (95 %, all places at once)" in one.sentence
    assert ("no more than" in one.sentence) == (one.distance_mm[worst] <= one.known_mm[worst])


@pytest.mark.parametrize("shared", [0.0, 0.7])
def test_errors_at_several_places_stay_below_together_in_95_of_100(shared):
    random = np.random.default_rng(1)
    errors = np.sqrt(1 - shared) * random.normal(size=(20_000, 5, 3))
    errors += np.sqrt(shared) * random.normal(size=(20_000, 1, 3))
    below = np.linalg.norm(errors, axis=2) <= radius_95(np.eye(3), at_once=5)
    assert below.all(axis=1).mean() > 0.945
    assert below.mean() < 0.995
