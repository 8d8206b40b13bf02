"""What was expected in a disguise is named, and the image is not called flipped for it; a flip still is."""

import numpy as np
import pytest

import sonocal as sc
from sonocal.existing import Existing, meaning_of
from sonocal.existing.expected import against_expected
from sonocal.simulation.scene import simulate_observations

LPS = np.diag([-1.0, -1.0, 1.0, 1.0])


def told(change):
    """The findings of a calibration that was told to expect its own truth, changed."""
    made = simulate_observations(2, 60, seed=3)
    expected = Existing("a.txt", "4 x 4", "", change(made.probe_from_image.matrix))
    found = sc.calibrate(made.observations, expected_rotation=meaning_of(expected.matrix).rotation)
    return against_expected(found, expected).diagnostics


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (np.linalg.inv, "is stored as the inverse"),
        (lambda m: LPS @ m @ LPS, "in LPS axes"),
        (lambda m: LPS @ m, "marker's axes in LPS"),
        (lambda m: np.diag([1e-3] * 3 + [1]) @ m, "is in metres"),
    ],
)
def test_a_disguise_of_what_is_expected_is_named_and_nothing_is_flipped(change, words):
    (found,) = told(change)
    assert (found.code, found.severity) == ("misread-matrix", "info")
    assert words in found.message


def test_what_is_expected_and_its_like_is_no_finding():
    assert told(lambda m: m) == ()


def test_other_mm_per_px_are_said():
    (found,) = told(lambda m: m @ np.diag([2.0, 2, 2, 1]))
    assert found.code == "expected-scale-differs"
    assert "+1" in found.message or "+9" in found.message


def test_an_image_that_is_flipped_is_still_called_so():
    flip = np.diag([-1.0, 1, -1, 1])
    flip[0, 3] = 500
    assert [one.code for one in told(lambda m: m @ flip)] == ["flipped-image"]
