"""Needles from what there is."""

import numpy as np
import pytest

from sonocal import DegenerateGeometryError
from sonocal.recording import Poses
from sonocal.targets import read_lines, write_lines
from sonocal.tools import (
    calibrate_pivot,
    calibrate_spin,
    digitise_point,
    needle_from_axis,
    needle_from_points,
)
from tests.builders.tracked_tools import TIP, pivoting, spinning


def test_pivot_and_spin_give_the_needle(tmp_path):
    rng = np.random.default_rng(0)
    found = needle_from_axis(calibrate_pivot(pivoting(rng)), calibrate_spin(spinning(rng)), 120.0)
    tip, back = found.line.segment_mm
    assert np.linalg.norm(tip - TIP) < 0.2
    # The marker's origin lies behind the tip: the shaft leads back to it.
    assert np.linalg.norm(back) < np.linalg.norm(tip)
    np.testing.assert_allclose(np.linalg.norm(back - tip), 120)
    assert found.direction_deviation_deg < 0.2
    assert found.diagnostics == ()
    write_lines([found.line], tmp_path / "needle.toml")
    (again,), fixed = read_lines(tmp_path / "needle.toml")
    assert (again.name, again.frame, fixed) == ("needle", "Needle", {})
    assert again.segment_mm.tobytes() == found.line.segment_mm.tobytes()


def test_a_tip_beside_the_axis_is_warned_of():
    rng = np.random.default_rng(0)
    pivot = calibrate_pivot(pivoting(rng, tip=TIP + np.array([5, 0, 0])))
    found = needle_from_axis(pivot, calibrate_spin(spinning(rng)), 120.0)
    assert [d.code for d in found.diagnostics] == ["tip-off-axis"]


def test_needle_from_two_points():
    found = needle_from_points([0, 0, 0], [0, 0, -100], (np.eye(3), np.eye(3)))
    assert found.direction_deviation_deg == pytest.approx(np.degrees(np.sqrt(2) / 100))
    assert [d.code for d in needle_from_points([0, 0, 0], [0, 0, 5]).diagnostics] == ["short-needle"]
    with pytest.raises(DegenerateGeometryError, match="its direction is free"):
        needle_from_points([0, 0, 0], [0, 0, 2], (np.eye(3), np.eye(3)))


def test_a_digitised_point_rests():
    rng = np.random.default_rng(0)
    stylus = pivoting(rng, n=50, noise_mm=0.1)
    found = digitise_point(Poses.of("Stylus", "Needle", stylus), TIP)
    np.testing.assert_allclose(found.point_mm, [100, -50, -1000], atol=0.1)
    stylus[:, :3, 3] += np.linspace(0, 30, 50)[:, None]
    with pytest.raises(DegenerateGeometryError, match="the stylus tip moved by"):
        digitise_point(Poses.of("Stylus", "Needle", stylus), TIP)
