"""Calibration from points, lines and planes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonocal as sc
from sonocal import registration as reg
from sonocal.calibration import calibration_json, parse_calibration
from sonocal.calibration.mixed import target_distances
from sonocal.errors import DegenerateGeometryError, InputError, UnsupportedError
from sonocal.validation import give_verdict, validate
from tests.builders.mixed_tables import mixed_table


@given(seed=st.integers(0, 10**6), flat=st.booleans())
@settings(max_examples=12)
def test_it_is_what_registration_makes_of_the_same_rows_in_any_order(seed, flat):
    truth, table = mixed_table(seed, flat=flat)
    found = sc.calibrate(table)
    order = np.random.default_rng(seed).permutation(len(table))
    again = sc.calibrate(table.select(order))
    sure = np.sqrt(np.trace(found.covariance[3:6, 3:6]))
    np.testing.assert_allclose(again.probe_from_image.matrix, found.probe_from_image.matrix, atol=1e-3 * sure)
    np.testing.assert_allclose(again.residuals_mm, found.residuals_mm[order], atol=1e-3)
    corners = np.array([[0.0, 0, 0], [500, 0, 0], [0, 500, 0]])
    off = np.linalg.norm(found.probe_from_image @ corners - truth @ corners, axis=1)
    assert np.all(off < 3 * found.predicted_errors()[2][:-1].max())
    if flat:
        points, lines = (table.select(table.spans == spans) for spans in (1, 2))
        planes = table.select(table.spans == 3)
        ends = np.pad(planes.points_px.reshape(-1, 2, 2), ((0, 0), (0, 0), (0, 1)))
        mix = reg.rows(
            reg.point_point(np.pad(points.points_px, ((0, 0), (0, 1))), points.spanning_mm[:, 0]),
            reg.point_line(np.pad(lines.points_px, ((0, 0), (0, 1))), lines.spanning_mm[:, :2]),
            reg.line_plane(ends, planes.spanning_mm[::2]),
        )
        theirs = reg.register(mix).target_from_source
        np.testing.assert_allclose(found.probe_from_image.matrix, theirs.matrix, atol=1e-3 * sure)


def test_distances_are_those_from_points_lines_and_planes():
    _, table = mixed_table(2)
    at = sc.Similarity(np.eye(3), np.zeros(3), 1.0)
    found = target_distances(at, table)
    for row in range(len(table)):
        place = np.r_[table.points_px[row], 0.0]
        spanning = table.spanning_mm[row, : table.spans[row]]
        sides = (spanning[1:] - spanning[0]).T
        away = place - spanning[0]
        if sides.size:
            away = away - sides @ np.linalg.lstsq(sides, away, rcond=None)[0]
        assert found[row] == pytest.approx(np.linalg.norm(away), rel=1e-9)


def test_a_sound_mix_is_used_and_says_what_was_not_looked_for():
    _, table = mixed_table(1, image_size_px=(640, 480))
    found = sc.calibrate(table)
    assert [(one.code, one.severity) for one in found.diagnostics] == [("unchecked-set-up", "info")]
    assert give_verdict(found).level == "use"
    assert found.certificate == "optimal"
    again = parse_calibration(calibration_json(found), "c.json")
    np.testing.assert_array_equal(again.probe_from_image.matrix, found.probe_from_image.matrix)
    np.testing.assert_allclose(again.covariance, found.covariance)
    assert again.certificate == "optimal"


def test_outliers_are_left_out_and_held_out_rows_measured():
    _, table = mixed_table(1, 20)
    spanning = table.spanning_mm.copy()
    spanning[table.spans == 1] += np.where(np.arange(20)[:, None, None] < 4, 60.0, 0.0)
    split = np.where(np.arange(len(table)) % 5 == 4, "test", "fit")
    moved = sc.Observations.of_targets(
        table.points_px, spanning, frame=table.frame, target=table.target, split=split
    )
    found = sc.calibrate(moved, test_split="test")
    given = moved.select(moved.split == "fit")
    moved_rows = (given.spans == 1) & (given.frame < 4)
    assert not found.inlier[moved_rows].any()
    assert found.inlier[~moved_rows].all()
    assert found.test.observations == (split == "test").sum()


def test_of_few_targets_no_error_is_predicted():
    _, table = mixed_table(1)
    one = sc.Observations.of_targets(table.points_px, table.spanning_mm, frame=table.frame)
    found = sc.calibrate(one)
    assert found.covariance is None
    assert "few-targets" in [one.code for one in found.warnings]
    assert give_verdict(found).level == "stop"


def test_rows_of_one_sighting_share_their_target():
    _, table = mixed_table(1)
    spanning = table.spanning_mm.copy()
    row = int(np.flatnonzero(table.spans == 3)[1])
    spanning[row] += 1.0
    torn = sc.Observations.of_targets(table.points_px, spanning, frame=table.frame, target=table.target)
    with pytest.raises(InputError, match=f"row {row}: has another target than observations, row {row - 1}"):
        sc.calibrate(torn)


def test_parallel_planes_leave_a_motion_free():
    random = np.random.default_rng(0)
    points = random.uniform(0, 500, (30, 3))
    spanning = np.array([[0.0, 0, 0], [100, 0, 0], [0, 100, 0]]) + np.zeros((30, 1, 1))
    spanning[..., 2] += points[:, 2, None] * 0.2
    names = np.array([f"plane {i}" for i in range(30)])
    with pytest.raises(DegenerateGeometryError):
        sc.calibrate(sc.Observations.of_targets(points, spanning, target=names))


def test_points_and_planes_have_no_threshold_from_the_noise():
    with pytest.raises(UnsupportedError, match="holds points or planes"):
        sc.calibrate(mixed_table(1)[1], threshold_mm="auto")


@given(seed=st.integers(0, 10**6), flat=st.booleans())
@settings(max_examples=12)
def test_scales_along_the_axes_are_those_that_the_image_was_stretched_by(seed, flat):
    truth, table = mixed_table(seed, flat=flat)
    stretch = np.array([1.0, 1.1, 0.95])[: table.dimension]
    found = sc.calibrate(replace(table, points_px=table.points_px * stretch), model="anisotropic")
    scales = found.scales_mm_per_px
    assert scales.shape == (table.dimension,)
    off = np.log(scales * stretch / truth.scale) / np.sqrt(np.diag(found.covariance)[6:])
    assert np.abs(off).max() < 5.5
    one = sc.calibrate(table)
    assert found.noise.row_mm < 1.5 * one.noise.row_mm
    assert found.models[0].contradicts or found.models[0].apart_95 > 0.03


def test_what_is_said_of_lines_alone_says_so():
    _, table = mixed_table(1)
    with pytest.raises(UnsupportedError, match=r"row 0: is of a point; .* lines alone"):
        validate(sc.calibrate(table), table)


@pytest.mark.parametrize(("factor", "unit"), [(0.001, "metres"), (0.1, "centimetres")])
def test_lengths_in_other_units_are_doubted(factor, unit):
    _, table = mixed_table(1)
    other = sc.Observations.of_targets(
        table.points_px, table.spanning_mm * factor, frame=table.frame, target=table.target
    )
    found = sc.calibrate(other)
    doubt = next(one for one in found.warnings if one.code == "implausible-units")
    assert unit in doubt.message
    assert give_verdict(found).level == "stop"
    assert "implausible-units" not in [one.code for one in sc.calibrate(table).diagnostics]
