"""Laws of the simulated scenes."""

import msgspec
import numpy as np
import pytest

from sonocal.geometry import Similarity
from sonocal.studies import Scene
from sonocal.studies.scene import (
    BLOCK_TRIALS,
    simulate_block,
)


def line_distances(truth, points, segments):
    """Distances (T, N) of mapped points to their lines."""
    mapped = np.einsum("tij,tnj->tni", truth[:, :3, :3], points) + truth[:, None, :3, 3]
    along = segments[:, :, 1] - segments[:, :, 0]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    away = mapped - segments[:, :, 0]
    return np.linalg.norm(away - np.sum(away * along, axis=-1, keepdims=True) * along, axis=-1)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("pool", [0, 50])
@pytest.mark.parametrize("tilt", [90.0, 20.0])
def test_true_points_lie_on_true_needles_under_the_true_calibration(dimension, pool, tilt):
    scene = Scene(dimension=dimension, needles=7, pool=pool, tilt_deg=tilt, needle_mm=200.0)
    trials = simulate_block(scene, 3, 1, 0)
    assert trials.points.shape == (BLOCK_TRIALS, 7 * (dimension - 1), 3)
    Similarity.from_matrix(trials.truth)  # raises where one is none
    assert line_distances(trials.truth, trials.true_points, trials.true_segments).max() < 1e-9
    lengths = np.linalg.norm(trials.true_segments[:, :, 1] - trials.true_segments[:, :, 0], axis=-1)
    np.testing.assert_allclose(lengths, 200.0, rtol=1e-12)
    assert trials.true_points.min() >= -1e-9
    assert trials.true_points.max() <= scene.image_px + 1e-9


@pytest.mark.parametrize("dimension", [2, 3])
def test_needles_lie_within_the_tilt(dimension):
    trials = simulate_block(Scene(dimension=dimension, tilt_deg=20.0), 0, 0, 0)
    along = trials.true_segments[:, :, 1] - trials.true_segments[:, :, 0]
    in_image = np.einsum("tji,tnj->tni", trials.truth[:, :3, :3], along)
    tilt = np.degrees(np.arccos(np.abs(in_image[..., 2]) / np.linalg.norm(in_image, axis=-1)))
    assert tilt.max() <= 20.0 + 1e-6
    assert tilt.max() > 19.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_noise_has_the_size_asked_for(dimension):
    scene = Scene(dimension=dimension, needles=20, sigma_px=2.0, sigma_mm=0.5)
    trials = simulate_block(scene, 0, 0, 0)
    off_px = (trials.points - trials.true_points)[..., :dimension]
    off_mm = trials.segments - trials.true_segments
    assert np.std(off_px) == pytest.approx(2.0, rel=0.03)
    assert np.std(off_mm) == pytest.approx(0.5, rel=0.03)
    if dimension == 2:
        assert np.all(trials.points[..., 2] == 0)
    else:  # both points of a needle see the same ends
        np.testing.assert_array_equal(trials.segments[:, ::2], trials.segments[:, 1::2])


def test_a_pool_keeps_probe_and_poses_and_renews_the_noise():
    scene = Scene(pool=50, needles=10)
    first, second = (simulate_block(scene, 0, 0, block) for block in (0, 1))
    np.testing.assert_array_equal(first.truth, np.broadcast_to(second.truth[0], first.truth.shape))
    poses = np.unique(np.concatenate([t.true_points.reshape(-1, 3) for t in (first, second)]), axis=0)
    assert len(poses) == 50
    for row in first.true_points[:20]:
        assert len(np.unique(row, axis=0)) == 10  # no pose twice in a trial
    assert len(np.unique(first.points.reshape(-1, 3), axis=0)) == first.points.shape[0] * 10


def test_outliers_are_as_many_as_asked_for_and_whole_needles():
    trials = simulate_block(Scene(dimension=3, needles=10, outlier_share=0.3, sigma_px=0.0), 0, 0, 0)
    assert np.all((~trials.sound).sum(axis=1) == 6)
    moved = np.any(trials.points != trials.true_points, axis=-1)
    np.testing.assert_array_equal(moved, ~trials.sound)


def test_latency_moves_needles_by_speed_times_time():
    scene = Scene(sigma_mm=0.0, latency_ms=100.0, speed_mm_s=30.0, turn_deg_s=0.0)
    trials = simulate_block(scene, 0, 0, 0)
    moved = np.linalg.norm(trials.segments - trials.true_segments, axis=-1)
    np.testing.assert_allclose(moved, 3.0, rtol=1e-9)
    still = simulate_block(msgspec.structs.replace(scene, latency_ms=0.0), 0, 0, 0)
    np.testing.assert_array_equal(still.segments, still.true_segments)


def test_turning_turns_about_the_images_centre():
    scene = Scene(sigma_mm=0.0, latency_ms=100.0, speed_mm_s=0.0, turn_deg_s=20.0)
    trials = simulate_block(scene, 0, 0, 0)
    centre = trials.truth[:, :3, :3] @ np.array([250.0, 250.0, 0.0]) + trials.truth[:, :3, 3]
    for ends in (0, 1):
        before, after = (s[:, :, ends] - centre[:, None] for s in (trials.true_segments, trials.segments))
        np.testing.assert_allclose(np.linalg.norm(after, axis=-1), np.linalg.norm(before, axis=-1), rtol=1e-9)
    along = [np.diff(s, axis=2)[:, :, 0] for s in (trials.true_segments, trials.segments)]
    cosine = np.sum(along[0] * along[1], axis=-1) / scene.needle_mm**2
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() <= 2.0 + 1e-6


def test_wires_are_where_the_tip_says_they_are():
    scene = Scene(crosswires=10, sigma_px=0.0, sigma_mm=0.0)
    trials = simulate_block(scene, 0, 0, 0)
    mapped = (
        np.einsum("tij,tkj->tki", trials.truth[:, :3, :3], trials.wire_points) + trials.truth[:, None, :3, 3]
    )
    np.testing.assert_allclose(mapped, trials.wire_places, atol=1e-9)
    noisy = simulate_block(msgspec.structs.replace(scene, probe_sigma_mm=0.3, probe_sigma_deg=0.2), 0, 0, 0)
    assert np.std(noisy.wire_places - trials.wire_places) > 0.3


def test_scenes_of_other_keys_blocks_and_seeds_share_nothing():
    scene = Scene()
    base = simulate_block(scene, 0, 0, 0)
    for arguments in ((1, 0, 0), (0, 1, 0), (0, 0, 1)):
        assert not np.any(simulate_block(scene, *arguments).points == base.points, where=[True, True, False])
