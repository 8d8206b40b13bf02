"""How lines and points are spread, against NumPy; and what does not change it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from sonocal import _core
from sonocal.errors import DegenerateGeometryError
from sonocal.geometry import Similarity, segment_directions
from sonocal.registration.degeneracy import direction_spread, refuse_degenerate_lines
from sonocal.registration.near_degeneracy import near_degeneracy
from sonocal.registration.rows import PointLineRows
from tests.builders.point_lines import moved, reordered, scene_rows
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 3_000)
dimensions = st.sampled_from([2, 3])


def principal(points):
    """(3,) root mean square extents by singular values."""
    centred = points - points.mean(axis=0)
    values = np.linalg.svd(centred, compute_uv=False)
    return np.pad(values, (0, 3))[:3] / np.sqrt(len(points))


def distances_to(segments, point):
    along = segment_directions(segments)
    away = point - segments[:, 0]
    return np.linalg.norm(away - np.sum(away * along, axis=1, keepdims=True) * along, axis=1)


@given(seeds, dimensions)
def test_extents_are_singular_values(seed, dimension):
    rows, _ = scene_rows(seed, dimension)
    extent = _core.extent(rows.core)
    np.testing.assert_allclose(extent.points, principal(rows.points), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(extent.ends, principal(rows.segments_mm.reshape(-1, 3)), rtol=1e-6, atol=1e-6)
    directions = segment_directions(rows.segments_mm)
    values, vectors = np.linalg.eigh(directions.T @ directions / len(rows))
    assert extent.direction_spread == pytest.approx(np.sqrt(values[0] + values[1]), rel=1e-9)
    assert abs(extent.common @ vectors[:, 2]) == pytest.approx(1, abs=1e-9)


@given(seeds)
def test_no_point_is_nearer_to_all_lines_than_their_meeting(seed):
    rows, _ = scene_rows(seed, 2)
    extent = _core.extent(rows.core)

    def mean_square(point):
        return np.mean(distances_to(rows.segments_mm, point) ** 2)

    assert extent.meeting_distance == pytest.approx(np.sqrt(mean_square(extent.meeting)), rel=1e-9)
    best = minimize(mean_square, extent.meeting + 5.0, tol=1e-12)
    assert extent.meeting_distance**2 <= best.fun * (1 + 1e-6)
    np.testing.assert_allclose(best.x, extent.meeting, atol=1e-2)


@given(seeds, dimensions)
def test_chosen_rows_are_seen_as_if_they_were_alone(seed, dimension):
    rows, _ = scene_rows(seed, dimension)
    chosen = np.random.default_rng(seed).random(len(rows)) < 0.5
    chosen[:3] = True
    some, alone = _core.extent(rows.core, chosen), _core.extent(rows.select(chosen).core)
    for name in ("common", "meeting", "ends", "points"):
        np.testing.assert_array_equal(getattr(some, name), getattr(alone, name))


@given(seeds, dimensions, st.sampled_from([1e-3, 1.0, 1e3]))
def test_a_moved_frame_moves_the_meeting_and_scales_lengths(seed, dimension, unit):
    rows, _ = scene_rows(seed, dimension)
    mover = random_similarity(seed, scale=unit)
    here, there = _core.extent(rows.core), _core.extent(moved(rows, mover).core)
    np.testing.assert_allclose(there.ends, unit * here.ends, rtol=1e-6)
    np.testing.assert_allclose(there.points, here.points)
    assert there.meeting_distance == pytest.approx(unit * here.meeting_distance, rel=1e-6)
    assert there.direction_spread == pytest.approx(here.direction_spread, rel=1e-9)
    size = np.linalg.norm(mover.translation) + unit * np.abs(rows.segments_mm).max()
    np.testing.assert_allclose(there.meeting, mover @ here.meeting, atol=1e-9 * size)
    assert abs(there.common @ mover.rotation @ here.common) == pytest.approx(1, abs=1e-9)


@given(seeds, dimensions)
def test_neither_the_order_of_rows_nor_of_ends_nor_rows_given_twice_matter(seed, dimension):
    rows, random = scene_rows(seed, dimension)[0], np.random.default_rng(seed)
    turned = np.where(
        random.random(len(rows))[:, None, None] < 0.5, rows.segments_mm[:, ::-1], rows.segments_mm
    )
    other = PointLineRows(rows.points, np.ascontiguousarray(turned), dimension)
    twice = np.repeat(random.permutation(len(rows)), 2)
    for altered in (other, reordered(other, twice)):
        here, there = _core.extent(rows.core), _core.extent(altered.core)
        for name in ("direction_spread", "meeting_distance", "meeting", "ends", "points"):
            np.testing.assert_allclose(getattr(there, name), getattr(here, name), rtol=1e-7, atol=1e-7)


def lines_of(kind: str, random: np.random.Generator, away: float) -> PointLineRows:
    """Lines that are exactly in a configuration of the paper's section 7, or away from it by so much."""
    points = np.column_stack([random.uniform(0, 500, (12, 2)), np.zeros(12)])
    if kind == "collinear-image-points":
        points[:, 1] = 3.0 + 2.0 * points[:, 0] + away * random.normal(size=12)
    along, middle = random.normal(size=(12, 3)), random.uniform(-50, 50, (12, 3))
    if kind == "parallel-lines":
        along = np.array([1.0, 2, 3]) + away * random.normal(size=(12, 3))
    if kind == "lines-through-one-point":
        middle = np.array([5.0, 6, 7]) + away * random.normal(size=(12, 3))
    if kind == "coplanar-lines":
        along[:, 2], middle[:, 2] = away * random.normal(size=12), 4.0 + away * random.normal(size=12)
    segments = np.stack([middle - 30 * along, middle + 40 * along], axis=1)
    return PointLineRows(points, segments, 2)


@pytest.mark.parametrize(
    "kind", ["parallel-lines", "lines-through-one-point", "coplanar-lines", "collinear-image-points"]
)
@given(seeds)
def test_what_leaves_a_motion_free_is_refused_by_its_name_in_any_frame(kind, seed):
    random = np.random.default_rng(seed)
    mover = random_similarity(seed, scale=1.0)
    with pytest.raises(DegenerateGeometryError) as caught:
        refuse_degenerate_lines(moved(lines_of(kind, random, 0.0), mover))
    assert caught.value.code == kind
    refuse_degenerate_lines(moved(lines_of(kind, random, 0.5), mover))  # no longer


@given(seeds)
def test_only_chosen_rows_count(seed):
    random = np.random.default_rng(seed)
    rows = lines_of("parallel-lines", random, 0.0)
    rows.segments_mm[:2, 1] += random.normal(size=(2, 3)) * 50
    refuse_degenerate_lines(rows)
    with pytest.raises(DegenerateGeometryError, match="all 10 lines are parallel"):
        refuse_degenerate_lines(rows, np.arange(12) >= 2)


@given(seeds, st.floats(0.005, 0.1))
def test_the_spread_of_directions_is_the_angle_that_they_were_given(seed, angle):
    random = np.random.default_rng(seed)
    turn = random.uniform(0, 2 * np.pi, 400)
    along = np.column_stack(
        [np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.full(400, np.cos(angle))]
    )
    carried = along @ random_similarity(seed).rotation.T
    rows = PointLineRows(np.zeros((400, 3)), np.stack([0 * carried, carried], axis=1), 2)
    assert direction_spread(rows) == pytest.approx(angle, rel=0.02)


@given(seeds)
def test_a_configuration_that_is_far_from_all_is_near_to_none(seed):
    random = np.random.default_rng(seed)
    all_of_them = np.ones(12, dtype=bool)
    for kind in ("parallel-lines", "collinear-image-points", "coplanar-lines"):
        near = near_degeneracy(lines_of(kind, random, 0.02), all_of_them)
        assert near is not None
        assert near.advice.startswith("add sightings")
    spread, _ = scene_rows(seed, 2, 60)
    found = near_degeneracy(spread, np.ones(60, dtype=bool))
    assert found is None or "point" in found.cause


def test_lines_that_meet_name_the_point():
    rows = lines_of("lines-through-one-point", np.random.default_rng(1), 0.0)
    with pytest.raises(DegenerateGeometryError, match=r"pass through one point, \(5, 6, 7\) mm"):
        refuse_degenerate_lines(rows)
    there = moved(rows, Similarity(np.eye(3), [1.0, 1, 1], 1.0))
    with pytest.raises(DegenerateGeometryError, match=r"\(6, 7, 8\) mm"):
        refuse_degenerate_lines(there)
