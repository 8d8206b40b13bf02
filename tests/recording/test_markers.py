"""Rigid bodies of markers: SciPy's alignment is the oracle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal import InputError
from sonocal.recording.markers import bodies_from_markers, rigid_fits
from sonocal.targets import Point
from tests.builders.recordings import random_poses
from tests.builders.trackers import SHAPE, marker_places

SEEDS = st.integers(0, 2**32)
LABELS = [f"Probe:{name}" for name in "abcd"]


def labelled(places, labels=LABELS):
    return {label: places[:, i] for i, label in enumerate(labels)}


@given(seed=SEEDS)
def test_the_fit_is_scipys(seed):
    rng = np.random.default_rng(seed)
    places = marker_places(random_poses(rng, 5)) + rng.normal(0, 0.5, (5, 4, 3))
    matrices, residuals = rigid_fits(SHAPE, places)
    for matrix, residual, place in zip(matrices, residuals, places, strict=True):
        turn, left = Rotation.align_vectors(place - place.mean(axis=0), SHAPE - SHAPE.mean(axis=0))
        np.testing.assert_allclose(matrix[:3, :3], turn.as_matrix(), atol=1e-9)
        np.testing.assert_allclose(2 * residual, left, rtol=1e-6)


@given(seed=SEEDS)
def test_no_fit_mirrors(seed):
    """Of a flat shape the best orthogonal matrix is as often a mirroring one."""
    rng = np.random.default_rng(seed)
    flat = SHAPE * [1, 1, 0]
    matrices, _ = rigid_fits(
        flat, marker_places(random_poses(rng, 20), flat) + rng.normal(0, 0.1, (20, 4, 3))
    )
    np.testing.assert_allclose(np.linalg.det(matrices[:, :3, :3]), 1)


def test_markers_on_one_line_or_too_few_give_no_pose():
    places = marker_places(random_poses(np.random.default_rng(0), 3))
    places[1, :2] = np.nan
    matrices, residuals = rigid_fits(SHAPE, places)
    assert np.isfinite(residuals).tolist() == [True, False, True]
    line = np.outer([0, 1, 2, 3.0], [10, 0, 0])
    assert np.isnan(rigid_fits(line, places)[0]).all()
    assert np.isfinite(matrices[[0, 2]]).all()


def test_without_a_model_a_tool_moves_as_its_markers_do():
    poses = random_poses(np.random.default_rng(0), 6)
    (found,), (note,) = bodies_from_markers(labelled(marker_places(poses)), (), "a.c3d")
    offset = np.linalg.inv(poses[0]) @ found.matrices[0]
    np.testing.assert_allclose(found.matrices, poses @ offset, atol=1e-9)
    np.testing.assert_allclose(found.matrices[0, :3, :3], np.eye(3), atol=1e-12)
    assert (note.code, found.source) == ("marker-fit", "Probe")
    assert note.message.startswith("Probe: 4 markers were fitted to the recording itself, 0.00 mm")


def test_a_marker_that_was_lost_where_the_shape_is_taken_is_left_out():
    places = marker_places(random_poses(np.random.default_rng(0), 6))
    places[:, 3] = np.nan
    (found,), _ = bodies_from_markers(labelled(places), (), "a.c3d")
    assert found.valid.all()


def test_what_is_no_rigid_body_is_refused():
    rng = np.random.default_rng(0)
    places = marker_places(random_poses(rng, 6)) + rng.normal(0, 20, (6, 4, 3))
    model = [Point(name, "Probe", place) for name, place in zip("abcd", SHAPE, strict=True)]
    with pytest.raises(
        InputError, match=r"a\.c3d: the markers of Probe \(a, b, c, d\) are [\d.]+ mm from one rigid"
    ):
        bodies_from_markers(labelled(places), model, "a.c3d")


def test_labels_without_a_tool_need_a_model():
    places = labelled(marker_places(random_poses(np.random.default_rng(0), 6)), "abcd")
    with pytest.raises(InputError) as caught:
        bodies_from_markers(places, (), "a.c3d")
    assert str(caught.value) == (
        "a.c3d: no tool has 3 markers or more; label them Tool:marker, or say with --markers which are of one "
        "tool; the labels are a, b, c, d"
    )
