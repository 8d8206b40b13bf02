"""How long frames repeat one another, against autocorrelations by NumPy; and what does not change it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal.registration.noise import stretch_length
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 5_000)


def drifting(seed, memory, frames=120, each=3):
    """Residuals of frames that remember so much of the one before, and the frames."""
    random = np.random.default_rng(seed)
    state = random.normal(size=3)
    means = []
    for _ in range(frames):
        state = memory * state + np.sqrt(1 - memory**2) * random.normal(size=3)
        means.append(state)
    frame = np.repeat(np.arange(frames), each)
    return np.array(means)[frame] + 0.3 * random.normal(size=(len(frame), 3)), frame


def by_numpy(residuals, frame):
    """The integrated autocorrelation time of the frames' means, cut where noise begins."""
    means = np.array([residuals[frame == f].mean(axis=0) for f in np.unique(frame)])
    count = len(means)
    if count < 16:
        return 1
    means -= means.mean(axis=0)
    whole = sum(np.correlate(column, column, "full")[count - 1 :] for column in means.T)
    shares = whole[1 : count // 2] / whole[0]
    noise = np.flatnonzero(shares < 3 / np.sqrt(2 * count))
    signal = shares[: noise[0]] if len(noise) else shares
    return int(min(np.ceil(1 + 2 * signal.sum()), count // 4))


@given(seeds, st.floats(0, 0.97))
def test_it_is_the_integrated_autocorrelation_time(seed, memory):
    residuals, frame = drifting(seed, memory)
    assert (
        abs(stretch_length(residuals, frame) - by_numpy(residuals, frame)) <= 1
    )  # rounding at a whole number


@given(seeds, st.sampled_from([0.0, 0.8, 0.95]), st.floats(1e-6, 1e6))
def test_neither_units_nor_axes_nor_a_common_offset_matter(seed, memory, unit):
    residuals, frame = drifting(seed, memory)
    turned = unit * residuals @ random_similarity(seed).rotation.T + unit * np.array([5.0, -3, 2])
    assert abs(stretch_length(turned, frame) - stretch_length(residuals, frame)) <= 1


@given(seeds, st.sampled_from([0.0, 0.8, 0.95]))
def test_neither_the_order_of_rows_nor_gaps_in_the_numbers_of_frames_matter(seed, memory):
    residuals, frame = drifting(seed, memory)
    order = np.random.default_rng(seed).permutation(len(frame))
    expected = stretch_length(residuals, frame)
    assert abs(stretch_length(residuals[order], frame[order]) - expected) <= 1
    assert stretch_length(residuals, 7 * frame - 1000) == expected
    assert abs(stretch_length(residuals[::-1], -frame[::-1]) - expected) <= 1  # back in time


@given(seeds)
def test_longer_memory_makes_longer_stretches(seed):
    lengths = [np.mean([stretch_length(*drifting(seed + i, m)) for i in range(4)]) for m in (0.0, 0.7, 0.97)]
    assert lengths[0] < lengths[1] < lengths[2]


@pytest.mark.parametrize("frames", [1, 2, 15])
def test_of_few_frames_nothing_is_said(frames):
    residuals, frame = drifting(0, 0.97, frames)
    assert stretch_length(residuals, frame) == 1


def test_residuals_alike_in_all_frames_have_nothing_to_repeat():
    assert stretch_length(np.ones((60, 3)), np.arange(60)) == 1


@given(seeds, st.integers(16, 60))
def test_there_are_four_stretches_at_least(seed, frames):
    trend = np.linspace(-1, 1, frames)[:, None] * np.random.default_rng(seed).normal(size=3)
    assert 1 < stretch_length(trend, np.arange(frames)) <= frames // 4
