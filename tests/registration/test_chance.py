"""Whether points and lines agree by chance: what is seen at a glance is what counting says."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sonocal import _core
from sonocal.registration.options import Options
from sonocal.registration.rows import PointLineRows
from sonocal.simulation.scene import simulate_observations

SEEDS = st.integers(0, 2**32 - 1)


def rows_of(dimension: int, needles: int, share: float, seed: int) -> PointLineRows:
    """Of needles of which a share is elsewhere in the image."""
    found = simulate_observations(dimension, needles, outlier_share=share, seed=seed).observations
    if dimension == 2:
        points = np.column_stack([found.points_px, np.zeros(needles)])
        return PointLineRows(points, found.segments_mm, 2)
    return PointLineRows(
        found.points_px, found.segments_mm, 3, np.repeat(np.arange(needles, dtype=np.int32), 2)
    )


def glance_and_count(rows: PointLineRows, threshold_mm: float = 5.0):
    options = Options(threshold_mm=threshold_mm, weighting="geometric", max_samples=300)
    found = _core.estimate(rows.core, rows.core_options(options))
    squares = found.residuals_mm.reshape(-1, rows.dimension - 1) ** 2
    at = _core.Transform(found.rotation, found.translation, found.scales)
    return found.plain, _core.agreement(rows.core, at, np.sqrt(squares.mean(axis=1)), threshold_mm)


@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=SEEDS, needles=st.integers(5, 60), share=st.floats(0, 0.99), threshold_mm=st.floats(1, 60))
@example(seed=0, needles=18, share=0.375, threshold_mm=38.0)  # residuals as large as the scene
@example(seed=11600, needles=18, share=0.375, threshold_mm=41.0)
@settings(max_examples=60)
def test_what_is_plain_at_a_glance_is_not_chance_when_counted(dimension, seed, needles, share, threshold_mm):
    plain, counted = glance_and_count(rows_of(dimension, needles, share, seed), threshold_mm)
    assert not (plain and counted.by_chance_alone)


@pytest.mark.parametrize(
    ("dimension", "needles", "share"), [(2, 50, 0.5), (3, 25, 0.5), (2, 100, 0.7), (3, 50, 0.7)]
)
def test_a_clear_consensus_is_plain(dimension, needles, share):
    for seed in range(5):
        plain, counted = glance_and_count(rows_of(dimension, needles, share, seed))
        assert plain
        assert not counted.by_chance_alone


@pytest.mark.parametrize("dimension", [2, 3])
def test_points_that_are_anywhere_are_not_plain(dimension):
    for seed in range(10):
        rows = rows_of(dimension, 30, 0.0, seed)
        rolled = replace(rows, segments_mm=np.roll(rows.segments_mm, dimension - 1, axis=0))
        plain, counted = glance_and_count(rolled)
        assert not plain
        assert counted.by_chance_alone


@given(seed=SEEDS)
@settings(max_examples=20)
def test_lines_are_counted_as_their_planes_are(seed):
    rows = rows_of(2, 20, 0.5, seed)
    planes = _planes(rows)
    found = _core.estimate(rows.core, rows.core_options(Options()))
    at = _core.Transform(found.rotation, found.translation, found.scales)
    one, other = (_core.agreement(table, at, found.residuals_mm, 5.0) for table in (rows.core, planes))
    assert one.agreeing == other.agreeing
    assert one.log_alarms == pytest.approx(other.log_alarms, rel=1e-6)


def _planes(rows: PointLineRows) -> _core.Table:
    from sonocal import registration as reg

    return reg.point_line(rows.points, rows.segments_mm).core
