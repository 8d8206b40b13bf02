"""A simulated sweep against itself: its truth, its recording, and the package's own chain from one to the other."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonocal as sc
from sonocal.geometry import predicted_points, segment_directions
from sonocal.recording import with_latency
from sonocal.recording.formats import read_recording
from sonocal.simulation.sweep import NEEDLE_MM, SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from sonocal.simulation.ultrasound_probe import curvilinear, curvilinear_3d, linear
from sonocal.targets import read_lines

SMALL = {
    "curvilinear": curvilinear(64, 64, 1.5),
    "linear": linear(64, 64, 0.6),
    "3d": curvilinear_3d(20, 5.0),
}
geometries = st.sampled_from(sorted(SMALL))
seeds = st.integers(0, 1000)


def sweep_of(name, seed, **options):
    return simulate_sweep(SMALL[name], options=SweepOptions(**{"frames": 40, "seed": seed} | options))


def ends_in_probe(sweep, latency_s=0.0):
    """(N, 2, 3): the needle's ends in the probe marker's frame as the recording tells them, and which hold."""
    poses = with_latency(sweep.recording, latency_s).between("Probe", "Needle")
    segment = sweep.lines[0].segment_mm
    return segment @ np.swapaxes(poses.matrices[:, :3, :3], 1, 2) + poses.matrices[
        :, None, :3, 3
    ], poses.valid


def distances(sweep, points_px, ends):
    """(N, k), mm: how far points of the image lie from the needle."""
    count, dimension = len(ends), sweep.recording.image.dimension
    places = sweep.truth.probe_from_image @ points_px.reshape(count, -1, dimension)
    return np.linalg.norm(np.cross(places - ends[:, :1], segment_directions(ends)[:, None]), axis=-1)


@settings(max_examples=12)
@given(geometries, seeds)
def test_without_noise_every_point_lies_on_the_tracked_needle(name, seed):
    sweep = sweep_of(name, seed, sigma_px=0.0, sigma_mm=0.0)
    ends, _ = ends_in_probe(sweep)
    assert distances(sweep, sweep.truth.points_px, ends).max() < 1e-6
    np.testing.assert_array_equal(sweep.truth.shown_px, sweep.truth.points_px)


@given(st.sampled_from(["curvilinear", "linear"]), seeds)
def test_a_needle_crosses_the_image_where_the_packages_own_geometry_says(name, seed):
    sweep = sweep_of(name, seed, sigma_px=0.0, sigma_mm=0.0)
    ends, _ = ends_in_probe(sweep)
    found = predicted_points(sweep.truth.probe_from_image, ends)
    np.testing.assert_allclose(found, sweep.truth.points_px, atol=1e-5)


@given(geometries, seeds)
def test_the_needle_keeps_its_length_and_the_image_lies_along_it(name, seed):
    sweep = sweep_of(name, seed, sigma_mm=0.0, sigma_px=0.0)
    ends, _ = ends_in_probe(sweep)
    np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), NEEDLE_MM, rtol=1e-9)
    points = sweep.truth.points_px.reshape(40, -1, sweep.recording.image.dimension)
    middle = (sweep.truth.probe_from_image @ points).mean(axis=1)
    along = np.sum((middle - ends[:, 0]) * segment_directions(ends), axis=1)
    assert np.all((along > 0) & (along < NEEDLE_MM))


@settings(max_examples=12)
@given(geometries, seeds, st.sampled_from([0.0625, 0.125, -0.0625]))
def test_taking_the_latency_out_puts_the_points_on_the_needle_again(name, seed, latency):
    """Whole steps of the recording, so that no pose is interpolated."""
    sweep = sweep_of(name, seed, sigma_px=0.0, sigma_mm=0.0, latency_s=latency, rate_hz=16.0)
    ends, valid = ends_in_probe(sweep, latency)
    assert valid.sum() == 40 - round(abs(latency) * 16)
    assert distances(sweep, sweep.truth.points_px, ends)[valid].max() < 1e-6
    late, _ = ends_in_probe(sweep)
    assert distances(sweep, sweep.truth.points_px, late).max() > 0.1


@pytest.mark.parametrize("name", SMALL)
def test_points_are_shown_with_the_noise_asked_for(name):
    sweep = sweep_of(name, 3, frames=2000, sigma_px=2.0, sigma_mm=0.0)
    points, shown = sweep.truth.points_px, sweep.truth.shown_px
    # A needle that lies flat crosses the image anywhere: its points move along it without end.
    off = shown - points
    across = np.abs(off) < 50
    assert np.median(np.abs(off[across])) / 0.6745 == pytest.approx(2.0, rel=0.1)
    assert np.mean(off[across]) == pytest.approx(0.0, abs=0.15)


@pytest.mark.parametrize("name", SMALL)
def test_the_tracked_tip_has_the_noise_asked_for(name):
    quiet, noisy = (sweep_of(name, 3, frames=1000, sigma_px=0.0, sigma_mm=s) for s in (0.0, 0.5))
    tips = [ends_in_probe(sweep)[0][:, 0] for sweep in (quiet, noisy)]
    assert np.std(tips[1] - tips[0]) == pytest.approx(0.5, rel=0.05)


@settings(max_examples=12)
@given(geometries, seeds)
def test_one_seed_is_one_sweep_and_another_another(name, seed):
    first, again, other = (sweep_of(name, s, dropout_share=0.2) for s in (seed, seed, seed + 1))
    for a, b in zip(first.recording.poses.values(), again.recording.poses.values(), strict=True):
        assert a.matrices.tobytes() == b.matrices.tobytes()
        np.testing.assert_array_equal(a.valid, b.valid)
    np.testing.assert_array_equal(first.truth.shown_px, again.truth.shown_px)
    np.testing.assert_array_equal(first.truth.visible, again.truth.visible)
    assert not np.any(first.truth.points_px == other.truth.points_px)


@settings(max_examples=12)
@given(geometries, seeds, st.floats(0, 1), st.floats(0, 1))
def test_as_many_poses_are_lost_and_needles_hidden_as_asked_for(name, seed, hidden, dropout):
    sweep = sweep_of(name, seed, hidden_share=hidden, dropout_share=dropout)
    for poses in sweep.recording.poses.values():
        assert (~poses.valid).sum() == round(dropout * 40)
        assert [s == "OK" for s in poses.status] == poses.valid.tolist()
    assert sweep.truth.visible.sum() <= 40 - round(hidden * 40)
    assert np.all(sweep.truth.clear <= sweep.truth.visible)


@given(geometries, seeds)
def test_every_pose_is_rigid(name, seed):
    sweep = sweep_of(name, seed)
    for poses in sweep.recording.poses.values():
        rotation = poses.matrices[:, :3, :3]
        np.testing.assert_allclose(
            rotation @ np.swapaxes(rotation, 1, 2), np.tile(np.eye(3), (40, 1, 1)), atol=1e-9
        )
        assert np.all(np.linalg.det(rotation) > 0)


@settings(max_examples=6)
@given(st.sampled_from(["curvilinear", "3d"]), seeds)
def test_the_truth_is_what_calibrating_its_points_gives(name, seed):
    """The whole way but detection: recording, poses, table, calibration."""
    sweep = sweep_of(name, seed, frames=80, sigma_px=0.0, sigma_mm=0.0, rate_hz=4.0)
    ends, _ = ends_in_probe(sweep)
    per_frame = sweep.recording.image.dimension - 1
    frame = np.repeat(np.arange(80), per_frame)
    rows = sc.Observations(sweep.truth.points_px.reshape(80 * per_frame, -1), ends[frame], frame=frame)
    found = sc.calibrate(rows).probe_from_image.matrix
    np.testing.assert_allclose(found, sweep.truth.probe_from_image.matrix, atol=1e-5)


@pytest.mark.parametrize("name", SMALL)
def test_a_written_sweep_is_read_as_it_was(name, tmp_path):
    sweep, done = sweep_of(name, 5, frames=4, dropout_share=0.25), []
    paths = write_sweep(sweep, tmp_path / "new" / "folder", lambda i, n: done.append((i, n)))
    read = read_recording(paths[0])
    assert done == [(i + 1, 4) for i in range(4)]
    np.testing.assert_allclose(read.times, sweep.recording.times, atol=1e-6)
    for a, b in zip(read.frames, sweep.recording.frames, strict=True):
        np.testing.assert_array_equal(a, b)
    for key, poses in sweep.recording.poses.items():
        np.testing.assert_array_equal(read.poses[key].valid, poses.valid)
        np.testing.assert_allclose(
            read.poses[key].matrices[poses.valid], poses.matrices[poses.valid], atol=1e-6
        )
    (line,), _ = read_lines(paths[1])
    np.testing.assert_array_equal(line.segment_mm, sweep.lines[0].segment_mm)
    truth = json.loads(paths[2].read_text())
    np.testing.assert_array_equal(truth["probe_from_image"], sweep.truth.probe_from_image.matrix)
    assert truth["visible"] == sweep.truth.visible.tolist()


def test_writing_into_a_file_for_a_folder_is_said(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(sc.InputError, match="cannot be made a folder"):
        write_sweep(sweep_of("3d", 0, frames=1), tmp_path / "file")
    assert (tmp_path / "file").read_text() == "in the way"


def test_an_overlay_brightens_its_own_pixels_alone():
    plain, drawn = (
        simulate_sweep(curvilinear(200, 200, 0.5), options=replace(SweepOptions(frames=3), overlay=overlay))
        for overlay in (False, True)
    )
    marks = [a != b for a, b in zip(plain.recording.frames, drawn.recording.frames, strict=True)]
    for frame, mark in zip(drawn.recording.frames, marks, strict=True):
        assert 0 < mark.mean() < 0.1
        assert set(np.unique(frame[mark])) <= {220, 230}
