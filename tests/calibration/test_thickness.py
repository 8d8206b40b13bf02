"""Needles seen by the first echo of a thick slice are warned of; those seen by the middle of their streaks are not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sonocal as sc

CODE = "slice-thickness"
SIDE, SCALE, NEEDLE_MM, LEAN = 500, 0.22, 220.0, 0.5


def seen_in_a_slice(seed, count, thickness_mm, *, end=True):
    """Stills of needles; the streak of each is taken at its shallower end, or in the middle."""
    rng = np.random.default_rng([seed, count])
    turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-80, 80, 3)
    middle = np.column_stack([rng.uniform(20, SIDE - 20, (count, 2)), np.zeros(count)])
    lean = LEAN * rng.normal(size=(count, 2))
    way = np.column_stack([lean, np.ones(count)])
    ends = (
        middle[:, None]
        + 0.5
        * NEEDLE_MM
        / SCALE
        * np.array([-1.0, 1.0])[:, None]
        * (way / np.linalg.norm(way, axis=1, keepdims=True))[:, None]
    )
    segments = SCALE * ends @ turn.T + shift + 0.4 * rng.normal(size=(count, 2, 3))
    # A third of the way across the slice is as good as any for whoever takes no end.
    half_px = 0.5 * thickness_mm / SCALE * lean
    up = -np.sign(half_px[:, 1:]) * half_px if end else rng.uniform(-1, 1, (count, 1)) * half_px
    points = middle[:, :2] + up + rng.normal(size=(count, 2))
    truth = sc.Similarity(turn, shift, SCALE)
    return sc.Observations(points, segments, image_size_px=(SIDE, SIDE)), truth


def said(rows):
    return [one for one in sc.calibrate(rows).warnings if one.code == CODE]


@pytest.mark.parametrize("thickness_mm", [4.0, 6.0])
def test_a_thick_slice_is_found_and_its_thickness_told(thickness_mm):
    for seed in range(5):
        (finding,) = said(seen_in_a_slice(seed, 400, thickness_mm)[0])
        told = float(finding.message.split("slice ")[1].split(" mm")[0])
        assert told == pytest.approx(thickness_mm, abs=1.0)
        assert "--centre mass" in finding.advice


@pytest.mark.parametrize("count", [10, 40, 200])
def test_thin_slices_are_not_accused(count):
    assert sum(bool(said(seen_in_a_slice(seed, count, 0.0)[0])) for seed in range(40)) <= 1


def test_streaks_taken_anywhere_are_noise():
    assert sum(bool(said(seen_in_a_slice(seed, 200, 4.0, end=False)[0])) for seed in range(20)) <= 1


def test_what_is_left_without_a_warning_is_within_its_bound():
    for seed in range(10):
        rows, truth = seen_in_a_slice(seed, 400, 6.0)
        found = sc.calibrate(rows)
        places, _, bound = found.predicted_errors()
        off = np.linalg.norm(found.probe_from_image @ places - truth @ places, axis=1)
        assert found.warnings or np.all(off <= 3 * bound)
