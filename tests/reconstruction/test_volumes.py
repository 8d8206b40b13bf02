"""Volumes of sweeps of a field that is known everywhere."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.fields import grey_at, path, probe_from_image, recorded

import sonocal as sc
from sonocal.reconstruction import pieces
from sonocal.recording import Poses

MASK = np.ones((80, 100), dtype=bool)
MODES = ["nearest", "linear", "between"]


def made(recording=None, **options):
    recording = recorded(path(40)) if recording is None else recording
    return sc.reconstruct(recording, probe_from_image(), **{"mask": MASK, "coverage": True, **options})


def voxels_mm(volume):
    z, y, x = np.indices(volume.values.shape)
    return np.stack([x, y, z], axis=-1) * volume.grid.spacing_mm + volume.grid.origin_mm


def inner(volume):
    """Voxels filled with all their neighbours: at the rim a value is of one side alone."""
    from scipy.ndimage import binary_erosion

    return binary_erosion(volume.coverage > 0, iterations=2)


def exact_mean(recording, volume, weights_of):
    """Means of pixels, reckoned in doubles of one array, one pixel after the other."""
    sums, total = np.zeros(volume.values.shape), np.zeros(volume.values.shape)
    v, u = np.mgrid[:80, :100]
    pixels = np.stack([u.ravel(), v.ravel(), np.zeros(u.size), np.ones(u.size)])
    for pose, image in zip(recording.poses["tracker_from_probe"].matrices, recording.frames, strict=True):
        at = ((pose @ probe_from_image() @ pixels)[:3].T - volume.grid.origin_mm) / volume.grid.spacing_mm
        for index, weight in weights_of(at):
            x, y, z = index.T
            ok = ((index >= 0) & (index < volume.grid.size)).all(axis=1)
            np.add.at(sums, (z[ok], y[ok], x[ok]), (weight * image.ravel())[ok])
            np.add.at(total, (z[ok], y[ok], x[ok]), weight[ok])
    return np.where(total > 1e-9, sums / np.maximum(total, 1e-9), np.nan)


def nearest_weights(at):
    yield np.floor(at + 0.5).astype(int), np.ones(len(at))


def linear_weights(at):
    low = np.floor(at).astype(int)
    part = at - low
    for corner in np.ndindex(2, 2, 2):
        yield low + corner, np.prod(np.where(corner, part, 1 - part), axis=1)


@pytest.mark.parametrize(("mode", "weights"), [("nearest", nearest_weights), ("linear", linear_weights)])
def test_a_mean_is_the_exact_mean_rounded(mode, weights):
    recording = recorded(path(12))
    volume = made(recording, interpolation=mode)
    exact = exact_mean(recording, volume, weights)
    known = np.isfinite(exact) & (volume.coverage > 0)
    assert known.sum() > 10_000
    assert np.abs(volume.values[known] - exact[known]).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("mode", MODES)
def test_a_volume_shows_the_field(mode):
    volume = made(interpolation=mode, spacing_mm=0.75 if mode == "nearest" else 0.5, speckle="kept")
    there = inner(volume)
    off = volume.values[there] - grey_at(voxels_mm(volume)[there])
    assert there.sum() > 5000
    assert np.sqrt(np.mean(off**2)) < {"nearest": 7, "linear": 3.5, "between": 1.0}[mode]
    assert abs(off.mean()) < 0.2


def test_between_frames_fills_what_lies_between_images():
    sparse = recorded(path(12, step_mm=2.4))
    filled = {mode: made(sparse, interpolation=mode).filled_share for mode in ("nearest", "between")}
    assert filled["between"] > 3 * filled["nearest"]
    few = made(sparse, longest_gap_mm=1.0)
    assert few.filled_share < 0.5 * filled["between"]


@pytest.mark.parametrize("compounding", ["mean", "maximum", "latest"])
@pytest.mark.parametrize("mode", MODES)
def test_bricks_and_threads_change_nothing(monkeypatch, mode, compounding):
    if mode == "linear" and compounding != "mean":
        pytest.skip("linear is a mean")
    options = {"interpolation": mode, "compounding": compounding, "spacing_mm": 0.4}
    whole = made(**options)
    several = made(**options, threads=3)
    monkeypatch.setattr(pieces, "SIDE", 17)
    bricks = made(**options, threads=2)
    for other in (several, bricks):
        np.testing.assert_array_equal(other.values, whole.values)
        np.testing.assert_array_equal(other.coverage, whole.coverage)
        assert other.filled == whole.filled


def test_few_images_at_a_time_change_nothing(monkeypatch):
    whole = {mode: made(interpolation=mode) for mode in MODES}
    monkeypatch.setattr("sonocal.reconstruction.batches.BATCH_BYTES", 3 * 8000)
    monkeypatch.setattr("sonocal.reconstruction.making.SUMS_BYTES", 1)
    monkeypatch.setattr(pieces, "SIDE", 24)
    for mode in MODES:
        np.testing.assert_array_equal(made(interpolation=mode).values, whole[mode].values)


def test_a_pose_that_is_missing_is_not_bridged():
    recording = recorded(path(20, step_mm=2.0))
    poses = recording.poses["tracker_from_probe"]
    valid = np.ones(20, dtype=bool)
    valid[8:12] = False
    lost = dataclasses.replace(
        recording, poses={"tracker_from_probe": dataclasses.replace(poses, valid=valid)}
    )
    volume, whole = made(lost, longest_gap_mm=50.0), made(recording, longest_gap_mm=50.0)
    assert volume.left_out == 4
    assert volume.filled < whole.filled - 0.15 * whole.filled


@pytest.mark.parametrize("mode", MODES)
def test_a_sweep_that_turns_back_and_one_image(mode):
    there_and_back = made(recorded(path(31, back=True)), interpolation=mode)
    there = made(recorded(path(16)), interpolation=mode)
    assert there_and_back.filled == pytest.approx(there.filled, rel=0.06)
    one = made(recorded(path(1)), interpolation=mode)
    assert one.images == 1
    assert one.filled > 500


@pytest.mark.parametrize("mode", MODES)
def test_images_of_16_bits_keep_them(mode):
    deep = made(recorded(path(10), dtype=np.uint16), interpolation=mode, speckle="kept")
    flat = made(recorded(path(10)), interpolation=mode, speckle="kept")
    assert deep.values.dtype == np.uint16
    assert np.abs(deep.values / 257 - flat.values).max() < 1.6


def test_the_reference_moves_with_what_it_is_tied_to():
    """The same sweep over something that moves, in the frame of that, is the same volume."""
    recording = recorded(path(10))
    rng = np.random.default_rng(1)
    moving = np.tile(np.eye(4), (10, 1, 1))
    moving[:, :3, 3] = rng.normal(0, 20, (10, 3))
    probe = recording.poses["tracker_from_probe"]
    tied = dataclasses.replace(
        recording,
        poses={
            "tracker_from_probe": Poses.of("Probe", "Tracker", moving @ probe.matrices),
            "tracker_from_reference": Poses.of("Reference", "Tracker", moving),
        },
    )
    volume = made(tied)
    assert volume.reference == "Reference"
    assert np.mean(volume.values == made(recording).values) > 0.999


@pytest.mark.parametrize("seed", range(3))
def test_smoothing_takes_out_a_quarter_of_the_error(seed):
    jitter = (0.3, 0.3)
    rms = {}
    for smooth in (False, True):
        volume = made(
            recorded(path(80, step_mm=0.4), jitter=jitter, seed=seed),
            noise_mm=jitter[0],
            noise_deg=jitter[1],
            smooth=smooth,
        )
        there = inner(volume)
        rms[smooth] = np.sqrt(np.mean((volume.values[there] - grey_at(voxels_mm(volume)[there])) ** 2))
    assert rms[True] < 0.75 * rms[False]


def test_smoothing_leaves_steady_poses_alone():
    bounds = [[-10, 13, 60], [14, 30, 80]]
    steady = made(bounds_mm=bounds)
    smoothed = made(bounds_mm=bounds, noise_mm=0.05, noise_deg=0.01, smooth=True)
    assert np.mean(np.abs(steady.values.astype(int) - smoothed.values) > 3) < 0.03


def test_the_error_is_what_the_tracker_leaves_unknown():
    volume = made(error=True, noise_mm=0.3, interpolation="nearest")
    there = volume.coverage > 0
    assert (volume.error_um[~there] == 0).all()
    # Of a normal distribution in space 95 % are within 2.796 standard deviations.
    np.testing.assert_allclose(volume.error_um[there], 300 * 2.796, rtol=0.01)
    further = made(error=True, noise_mm=0.3, noise_deg=0.3, interpolation="nearest")
    assert further.error_um[there].min() > volume.error_um[there].max()
