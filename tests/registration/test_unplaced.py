"""Targets whose place nobody knows: exact without noise, carried along by what is moved, or refused by name."""

import numpy as np
import pytest
from benchmarks.simulators.places import Noise, image_points, sweep
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal.errors import DegenerateGeometryError, InputError
from sonocal.geometry import Similarity
from sonocal.registration.unplaced import UnplacedTarget, register_unplaced
from tests.builders.motion import random_pose

KINDS = ["point", "line", "plane"]
ENOUGH = {"point": 12, "line": 14, "plane": 20}
few_seeds = st.integers(0, 10**6)


def registered(scene, kind, *, points=None, poses=None, **options):
    """What is found of a scene's rows, or of others in their place."""
    points = scene.points_px if points is None else points
    return register_unplaced(
        points[:, : scene.dimension],
        scene.poses if poses is None else poses,
        [UnplacedTarget(kind)],
        frame=scene.frame,
        **options,
    )


def errors_mm(matrix, scene):
    places = image_points(scene.dimension)
    return np.linalg.norm(places @ (matrix - scene.truth)[:3, :3].T + (matrix - scene.truth)[:3, 3], axis=1)


def off_place_mm(place, spanning):
    """(K,): of points that span where a target is, from where it was found."""
    away = spanning - place.middle_mm
    if place.kind == "plane":
        return np.abs(away @ place.direction)
    along = np.zeros(3) if place.direction is None else place.direction
    return np.linalg.norm(away - np.outer(away @ along, along), axis=1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=few_seeds, tracked=st.booleans())
@settings(max_examples=8)
def test_without_noise_calibration_and_place_are_exact(kind, dimension, seed, tracked):
    scene = sweep(kind, ENOUGH[kind], seed, dimension=dimension, tracked=tracked)
    found = registered(scene, kind)
    assert errors_mm(found.marker_from_source.matrix, scene).max() < 1e-6
    assert off_place_mm(found.places[0], scene.place).max() < 1e-6
    assert found.residuals_mm.max() < 1e-6
    assert found.inlier.all()


@given(seed=few_seeds, kind=st.sampled_from(KINDS))
@settings(max_examples=10)
def test_turning_the_marker_turns_the_calibration_and_moving_the_target_moves_its_place(seed, kind):
    scene = sweep(kind, 40, seed, Noise())
    of_marker, of_target = random_pose(seed + 1), random_pose(seed + 2)
    of_marker[:3, 3] = 0  # a pose is as noisy as its marker is far away
    here = registered(scene, kind)
    there = registered(scene, kind, poses=of_marker @ scene.poses @ of_target)
    np.testing.assert_allclose(
        image_points() @ there.marker_from_source.matrix[:3, :3].T + there.marker_from_source.translation,
        Similarity.from_matrix(of_marker) @ (here.marker_from_source @ image_points()),
        atol=1e-2,
    )
    back = np.linalg.inv(of_target)
    found = here.places[0]
    middle = there.places[0].middle_mm
    place = back[:3, :3] @ found.middle_mm + back[:3, 3]
    direction = None if found.direction is None else back[:3, :3] @ found.direction
    away = middle - place
    if kind == "plane":
        assert abs(away @ direction) < 1e-2
    else:
        assert np.linalg.norm(away - (0 if direction is None else away @ direction * direction)) < 1e-2


@given(seed=few_seeds, kind=st.sampled_from(KINDS))
@settings(max_examples=10)
def test_the_order_of_rows_and_the_unit_of_pixels_change_nothing(seed, kind):
    scene = sweep(kind, 30, seed, Noise())
    here = registered(scene, kind)
    shuffled = np.random.default_rng(seed).permutation(len(scene.frame))
    there = register_unplaced(
        scene.points_px[shuffled, :2],
        scene.poses[shuffled],
        [UnplacedTarget(kind)],
        frame=scene.frame[shuffled],
    )
    assert (
        np.abs(
            errors_mm(here.marker_from_source.matrix, scene)
            - errors_mm(there.marker_from_source.matrix, scene)
        ).max()
        < 1e-2
    )
    np.testing.assert_array_equal(there.inlier, here.inlier[shuffled])
    np.testing.assert_allclose(there.residuals_mm, here.residuals_mm[shuffled], atol=1e-2)


def test_as_many_frames_off_as_the_search_stands_are_found_out():
    for kind, share in (("point", 0.4), ("line", 0.2), ("plane", 0.2)):
        scene = sweep(kind, 60, 7, Noise(), wrong=share)
        found = registered(scene, kind)
        assert found.inlier[~scene.wrong].mean() > 0.98
        assert found.inlier[scene.wrong].mean() < 0.25
        assert errors_mm(found.marker_from_source.matrix, scene).max() < 3


@pytest.mark.parametrize(
    ("motion", "code", "said"),
    [
        ("translation", "unplaced-translation", "hardly turned"),
        ("about one axis", "unplaced-one-axis", "about one axis only"),
        ("yaw", "unplaced-one-axis", "about one axis only"),
        ("pivot", "unplaced-pivot", "stays at one place of the image"),
    ],
)
@pytest.mark.parametrize("kind", KINDS)
def test_a_motion_that_tells_too_little_is_refused_by_name(motion, code, said, kind):
    if motion == "pivot" and kind == "plane":
        said, code = "leaves the scale free", "unplaced-scale"
    with pytest.raises(DegenerateGeometryError, match=said) as refused:
        registered(sweep(kind, 60, 3, Noise(), motion=motion), kind)
    assert refused.value.code == code


def test_what_is_no_table_is_refused():
    scene = sweep("line", 20, 1)
    thread = [UnplacedTarget("line")]
    points, poses = scene.points_px[:, :2], scene.poses
    for given_points, given_poses, targets, more, said in [
        (points[:, :1], poses, thread, {}, "points must have shape"),
        (points, poses[:5], thread, {}, "marker_from_body must have shape"),
        (points, poses * 2, thread, {}, "a pose is not rigid"),
        (points, poses, [], {}, "target counts"),
        (points, poses, [UnplacedTarget("wire")], {}, "kind of a target is 'wire'"),
        (points, poses, thread, {"frame": np.zeros(3, int)}, "frame must be 20 whole numbers"),
        (points, poses, thread, {"target": np.ones(20, int)}, "target counts from 0 to 1"),
        (points, poses, thread, {"threshold_mm": -1}, "threshold_mm"),
        (np.where(points > 0, np.nan, points), poses, thread, {}, "not finite|finite"),
    ]:
        with pytest.raises(InputError, match=said):
            register_unplaced(given_points, given_poses, targets, **more)
