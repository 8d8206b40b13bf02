"""Three points on one line are told from a plane, whatever their units and place, by the core's own rule."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal.geometry import on_one_line


@given(st.integers(0, 10**6), st.floats(1e-3, 1e3), st.permutations(range(3)))
def test_units_and_order_do_not_matter(seed, unit, order):
    random = np.random.default_rng(seed)
    points = random.normal(size=(3, 3))
    line = points[0] + np.array([[0.0], [1.0], [2.5]]) * points[1]
    assert not on_one_line(unit * points[list(order)])
    assert on_one_line(unit * line[list(order)])
    many = np.stack([points, line, points])
    np.testing.assert_array_equal(on_one_line(many), [False, True, False])


def test_what_is_no_number_spans_nothing():
    points = np.eye(3)
    points[2, 1] = np.nan
    assert on_one_line(points)


@pytest.mark.parametrize("aside", [0.0, 1e-12, 1e-6, 1.0])
def test_the_core_has_the_same_rule(aside):
    from sonocal import _core

    spanning = np.array([[[0.0, 0, 0], [10, 0, 0], [20, aside, 0]]])
    about = np.zeros((1, 3)), np.array([0, 1], dtype=np.int32), spanning, np.array([3], dtype=np.int32)
    if on_one_line(spanning[0]):
        with pytest.raises(ValueError, match="on one line"):
            _core.Table.of_targets(*about, dimension=2)
    else:
        assert len(_core.Table.of_targets(*about, dimension=2)) == 1
