"""The axis by spinning."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import DegenerateGeometryError
from sonocal.tools import calibrate_spin
from tests.builders.tracked_tools import AXIS, TIP, pivoting, spinning


@given(st.integers(0, 10**6))
def test_spin_finds_the_axis(seed):
    found = calibrate_spin(spinning(np.random.default_rng(seed), wobble_deg=0.0))
    assert abs(found.direction @ AXIS) == pytest.approx(1.0, abs=1e-9)
    off = TIP - found.point_mm
    np.testing.assert_allclose(np.cross(off, AXIS), 0, atol=1e-5)
    assert abs(found.point_mm @ AXIS) < 1e-5


def test_spin_covariance_covers_the_truth():
    angles, promised = [], []
    for seed in range(40):
        found = calibrate_spin(spinning(np.random.default_rng(seed), wobble_deg=1.0))
        angles.append(np.linalg.norm(np.cross(found.direction, AXIS)) ** 2)
        promised.append(np.trace(found.covariance))
    assert 0.5 < np.mean(angles) / np.mean(promised) < 2.0


def test_spin_refuses_what_is_none():
    rng = np.random.default_rng(0)
    with pytest.raises(DegenerateGeometryError, match="the tool hardly turned") as caught:
        calibrate_spin(spinning(rng, turn_deg=5.0))
    assert caught.value.code == "still"
    with pytest.raises(DegenerateGeometryError, match="turned about more than one axis") as caught:
        calibrate_spin(pivoting(rng, tilt_deg=60))
    assert caught.value.code == "not-a-spin"
