"""A correspondence that is given again is no second measurement; a target that is mirrored is named."""

import numpy as np
import pytest
from benchmarks.register_trust import MAKERS
from benchmarks.simulators.mixes import mix_of
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal import registration as reg
from sonocal.errors import MirroredVolumeError, NoConsensusError

SEEDS = st.integers(0, 2**20)


@pytest.mark.parametrize("kind", list(MAKERS))
@given(SEEDS)
@settings(max_examples=4, deadline=None)
def test_copies_in_any_order_change_nothing(kind, seed):
    (part,) = mix_of({kind: 14}, seed).parts
    order = np.random.default_rng(seed).permutation(np.repeat(np.arange(14), 3))
    once = reg.register(MAKERS[kind](part.source, part.target))
    again = reg.register(MAKERS[kind](part.source[order], part.target[order]))
    assert again.freedom == pytest.approx(once.freedom, rel=1e-3)
    size = np.sqrt(np.diag(once.covariance))
    correlation = again.covariance / np.outer(size, size)
    np.testing.assert_allclose(correlation, once.covariance / np.outer(size, size), atol=0.05)
    np.testing.assert_allclose(again.residuals_mm, once.residuals_mm[order], atol=1e-3)
    assert np.array_equal(again.inlier, once.inlier[order])


def test_of_one_deviation_each_copies_count_once_and_others_do_not():
    (part,) = mix_of({"point_point": 10}, 3).parts
    twice = np.tile(np.arange(10), 2)
    rows = reg.point_point(part.source[twice], part.target[twice])
    alike = reg.register(rows, sigma_mm=np.ones(20))
    unlike = reg.register(rows, sigma_mm=np.repeat([1.0, 2.0], 10))
    once = reg.register(reg.point_point(part.source, part.target), sigma_mm=np.ones(10))
    assert alike.freedom == once.freedom
    assert unlike.freedom > once.freedom


@given(SEEDS, st.sampled_from(["point_point", "line_line"]))
@settings(max_examples=10, deadline=None)
def test_a_left_handed_target_is_refused_and_a_plane_of_points_has_no_hand(seed, kind):
    (part,) = mix_of({kind: 40}, seed).parts
    mirror = np.array([1.0, 1.0, -1.0])
    with pytest.raises(NoConsensusError) as refused:
        reg.register(MAKERS[kind](part.source, part.target * mirror))
    if kind == "point_point":
        assert isinstance(refused.value, MirroredVolumeError)
        assert "one side is left-handed" in str(refused.value)
    reg.register(MAKERS[kind](part.source, part.target))
    flat = part.source * [1.0, 1.0, 0.0]
    if kind == "point_point":
        target = flat * mirror + np.random.default_rng(seed).normal(0, 0.1, flat.shape)
        assert reg.register(reg.point_point(flat, target)).inlier.all()
