"""Paper section 7: each configuration recognised, wherever the marker is, and its neighbours not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.geometry import homogeneous_points
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 5_000)
TRUTH = random_similarity(11, scale=0.24)
TRUTH_MARKER = random_similarity(5, scale=1.0)


def scene(directions, points_px, marker):
    """Noise-free rows: lines of these directions (image axes) through these image points."""
    middle = TRUTH @ points_px
    along = directions @ TRUTH.rotation.T * 50
    segments = np.stack([middle - along, middle + 3 * along], axis=1)
    return sc.Observations(np.asarray(points_px)[:, :2], marker @ segments)


def image_points(rng, count=12):
    return np.column_stack([rng.uniform(0, 500, (count, 2)), np.zeros(count)])


def refused(rows):
    with pytest.raises(sc.DegenerateGeometryError) as caught:
        sc.calibrate(rows)
    return caught.value


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@given(seeds)
def test_parallel_lines(seed):
    rng, marker = np.random.default_rng(seed), random_similarity(seed, scale=1.0)
    signs = rng.choice([-1, 1], (12, 1))
    error = refused(scene(signs * unit(rng.normal(size=3)), image_points(rng), marker))
    assert error.code == "parallel-lines"
    assert str(error) == (
        "all 12 lines are parallel, so the image can slide along them; "
        "tilt the needle between sightings, by 30 degrees or more"
    )


@given(seeds)
def test_lines_through_one_point(seed):
    rng, marker = np.random.default_rng(seed), random_similarity(seed, scale=1.0)
    points = image_points(rng)
    apex = np.array([100.0, 250.0, rng.uniform(50, 400)])
    error = refused(scene(unit(points - apex), points, marker))
    assert error.code == "lines-through-one-point"
    x, y, z = marker @ (TRUTH @ apex)
    assert str(error) == (
        f"all 12 lines pass through one point, ({x:.3g}, {y:.3g}, {z:.3g}) mm in the probe marker's frame, "
        "so the scale is free; move the needle sideways as well as turning it"
    )


@given(seeds)
def test_coplanar_lines_of_a_2d_probe(seed):
    rng, marker = np.random.default_rng(seed), random_similarity(seed, scale=1.0)
    points = np.column_stack([rng.uniform(0, 500, 12), np.full(12, 200.0), np.zeros(12)])
    angle = rng.uniform(0.2, np.pi - 0.2, 12)
    directions = np.column_stack([np.cos(angle), 0.3 * np.sin(angle), np.sin(angle)])
    error = refused(scene(unit(directions), points, marker))
    assert error.code == "coplanar-lines"
    assert str(error) == (
        "all 12 lines lie in one plane, so their image points lie on one line and the image can turn about it; "
        "scan the needle at places all over the image, with tilts in two directions"
    )


@given(seeds)
def test_image_points_on_one_line(seed):
    rng, marker = np.random.default_rng(seed), random_similarity(seed, scale=1.0)
    u = rng.uniform(0, 500, 12)
    error = refused(scene(unit(rng.normal(size=(12, 3))), np.column_stack([u, 3 + 0.5 * u, 0 * u]), marker))
    assert error.code == "collinear-image-points"
    assert str(error) == (
        "all 12 image points lie on one line and the image can turn about it; "
        "scan the needle at places all over the image, with tilts in two directions"
    )


def test_one_image_point():
    rng = np.random.default_rng(0)
    directions, points = unit(rng.normal(size=(12, 3))), np.tile([100.0, 200, 0], (12, 1))
    shifted = scene(directions, image_points(rng), random_similarity(0, scale=1.0))
    error = refused(sc.Observations(points[:, :2], shifted.segments_mm))
    assert error.code == "one-image-point"
    assert str(error) == (
        "all 12 rows have the same image point, so the image can turn about it; "
        "scan the needle at places all over the image"
    )


def test_degeneracy_that_outliers_hide_is_refused_once_they_are_known():
    rng = np.random.default_rng(1)
    rows = scene(np.tile([0.1, 0.2, 0.97], (20, 1)), image_points(rng, 20), random_similarity(1, scale=1.0))
    segments = rows.segments_mm.copy()
    segments[:2] = rng.normal(size=(2, 2, 3)) * 100
    with pytest.raises(sc.SonocalError) as caught:
        sc.calibrate(sc.Observations(rows.points_px, segments))
    assert isinstance(caught.value, sc.DegenerateGeometryError)


def line_rows(image_ends, marker=None):
    """3D rows: both ends of each image line (N, 2, 3), and longer needles through them."""
    ends = TRUTH @ image_ends
    along = ends[:, 1] - ends[:, 0]
    segments = np.stack([ends[:, 0] - along, ends[:, 1] + along], axis=1)
    frame = np.repeat(np.arange(len(image_ends)), 2)
    marker = marker or random_similarity(2, scale=1.0)
    return sc.Observations(image_ends.reshape(-1, 3), marker @ segments[frame], frame=frame)


def test_parallel_lines_of_a_3d_probe():
    starts = np.random.default_rng(2).uniform(0, 500, (6, 3))
    assert (
        refused(line_rows(np.stack([starts, starts + np.array([100, 50, 20])], axis=1))).code
        == "parallel-lines"
    )


def test_lines_of_a_3d_probe_through_one_point():
    starts = np.random.default_rng(2).uniform(0, 500, (6, 3))
    ends = np.stack([starts, starts + 0.4 * ([250, 250, 250] - starts)], axis=1)
    assert refused(line_rows(ends)).code == "lines-through-one-point"


def test_two_coplanar_lines_of_a_3d_probe_meet_and_leave_the_scale_free():
    ends = np.random.default_rng(2).uniform(0, 500, (2, 2, 3))
    ends[..., 2] = 100
    assert refused(line_rows(ends)).code == "lines-through-one-point"


@pytest.mark.parametrize("count", [3, 6])
def test_three_coplanar_lines_of_a_3d_probe_are_enough(count):
    ends = np.random.default_rng(2).uniform(0, 500, (count, 2, 3))
    ends[..., 2] = 100
    marker = random_similarity(2, scale=1.0)
    found = sc.calibrate(line_rows(ends, marker)).probe_from_image
    np.testing.assert_allclose(found.matrix, marker.matrix @ TRUTH.matrix, atol=1e-6)


@pytest.mark.parametrize("tilt_deg", [1, 3, 10])
def test_nearly_parallel_lines_are_answered_with_a_warning_in_proportion(tilt_deg):
    rng = np.random.default_rng(5)
    spread = np.tan(np.radians(tilt_deg))
    directions = unit(np.array([0.1, 0.2, 1]) + spread * rng.normal(size=(40, 3)))
    rows = scene(directions, image_points(rng, 40), random_similarity(5, scale=1.0))
    noisy = sc.Observations(
        rows.points_px + rng.normal(size=rows.points_px.shape),
        rows.segments_mm + 0.3 * rng.normal(size=rows.segments_mm.shape),
    )
    found = sc.calibrate(noisy)
    corners = homogeneous_points(found.predicted_errors()[0])
    missed = np.linalg.norm(
        found.probe_from_image @ corners - random_similarity(5, scale=1.0) @ (TRUTH @ corners), axis=1
    )
    assert np.all(missed < 2 * found.predicted_errors()[2])
    warned = [d for d in found.warnings if d.code == "weak-motion"]
    assert bool(warned) == (tilt_deg < 10)
    if warned:
        assert "all needles lie within" in warned[0].message
        assert warned[0].advice == "add sightings with the needle tilted by 30 deg or more, in two directions"


def near(kind, distance, rng, count=30):
    """Image points and directions (image axes) that a configuration of section 7 is left by so much."""
    points = image_points(rng, count)
    directions = rng.normal(size=(count, 3))
    directions[:, 2] = np.abs(directions[:, 2]) + 0.3
    if kind == "one direction":
        directions = [0.2, 0.1, 1.0] + distance * rng.normal(size=(count, 3))
    if kind == "one point":
        directions = [250.0, 250.0, 400.0] + 500 * distance * rng.normal(size=(count, 3)) - points
    if kind in ("one line", "one plane"):
        points[:, 1] = 250 + 250 * distance * rng.uniform(-1, 1, count)
    if kind == "one plane":
        directions[:, 1] = distance * rng.normal(size=count)
    return points, unit(directions)


@pytest.mark.parametrize("kind", ["one direction", "one point", "one line", "one plane"])
def test_near_degenerate_sightings_are_warned_of_with_their_distance(kind):
    marker = random_similarity(5, scale=1.0)
    predicted = []
    for distance in (0.03, 0.05, 0.07, 0.5):
        rng = np.random.default_rng(8)
        points, directions = near(kind, distance, rng)
        rows = scene(directions, points, marker)
        noisy = sc.Observations(
            rows.points_px + 0.3 * rng.normal(size=rows.points_px.shape),
            rows.segments_mm + 0.3 * rng.normal(size=rows.segments_mm.shape),
        )
        found = sc.calibrate(noisy, image_size_px=(500, 500), tolerance_mm=1.2)
        corners, _, radius = found.predicted_errors()
        missed = np.linalg.norm(found.probe_from_image @ corners - marker @ (TRUTH @ corners), axis=1)
        assert np.all(missed < 2 * radius)
        predicted.append(radius.max())
        warned = [d for d in found.warnings if d.code == "weak-motion"]
        assert bool(warned) == (distance < 0.5)
        if warned:
            assert kind in warned[0].message
            assert warned[0].advice.startswith("add sightings")
    # The further away, the surer.
    assert predicted == sorted(predicted, reverse=True)


@pytest.mark.parametrize("tilt", [0.01, 0.05])
def test_needles_in_the_image_plane_are_warned_of(tilt):
    rng = np.random.default_rng(9)
    points = image_points(rng, 30)
    directions = rng.normal(size=(30, 3))
    assert not sc.calibrate(scene(unit(directions), points, TRUTH_MARKER)).warnings
    directions[:, 2] = tilt * rng.normal(size=30)
    found = sc.calibrate(scene(unit(directions), points, TRUTH_MARKER))
    assert [w.code for w in found.warnings] == ["needle-in-image-plane"]


@pytest.mark.parametrize("seed", range(10))
def test_a_volume_of_nearly_parallel_needles_is_not_called_mirrored(seed):
    """It fits a mirrored volume as well: what it leaves free is named, not an axis that runs the wrong way."""
    rng = np.random.default_rng(seed)
    along = np.array([0.0, 0.0, 1.0]) + 0.001 * rng.normal(size=(10, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    places = np.column_stack([rng.uniform(0, 100, (10, 2)), np.zeros(10)])
    ends = np.stack([places - 50 * along, places + 150 * along], axis=1)
    points = np.stack([places + 10 * along, places + 40 * along], axis=1) / 0.25
    points = points.reshape(-1, 3) + rng.normal(size=(20, 3))
    rows = sc.Observations(
        points, np.repeat(ends, 2, axis=0) + 0.3 * rng.normal(), frame=np.repeat(np.arange(10), 2)
    )
    with pytest.raises(sc.DegenerateGeometryError) as refused:
        sc.calibrate(rows)
    assert refused.value.code == "parallel-lines"
    assert "mirror" not in str(refused.value)
