"""From a recording to a calibration, for images and volumes through the same code."""

from dataclasses import replace

import numpy as np
import pytest

import sonocal as sc
from sonocal.detection import detect
from sonocal.geometry import similarity_errors
from sonocal.observations import observations_csv, parse_observations
from sonocal.recording import ArrayFrames, Poses, with_latency
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear, curvilinear_3d
from sonocal.sweep import (
    Options,
    calibrate_candidates,
    calibrate_points,
    calibrate_recording,
    candidates,
    choice,
    tabulate,
)
from tests.builders.recordings import random_poses
from tests.builders.sweeps import scan_of, with_marker_moved, with_tracker_moved

DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])


def calibrated(scan, **keywords):
    """From detections that were made before: the images stay closed, so there is no second look."""
    keywords = {"second_look": False, **keywords}
    return calibrate_recording(scan.recording, scan.lines, detections=scan.detections, **keywords)


@pytest.fixture(scope="module", params=[2, 3])
def decoyed(request):
    return scan_of(request.param, 60, seed=3, decoys=3, hidden=0.2)


@pytest.fixture(scope="module")
def swept():
    """A small sweep of either kind, its images made once."""
    sweeps = {
        2: simulate_sweep(
            curvilinear(128, 128, 0.94),
            BATH,
            SweepOptions(frames=40, rate_hz=4, sigma_px=0.3, sigma_mm=0.3, seed=1),
        ),
        3: simulate_sweep(
            curvilinear_3d(48, 2.4),
            options=SweepOptions(frames=24, rate_hz=3, sigma_px=0.1, sigma_mm=0.3, seed=2),
        ),
    }
    return {
        dimension: replace(
            sweep,
            recording=replace(sweep.recording, frames=ArrayFrames(np.stack(list(sweep.recording.frames)))),
        )
        for dimension, sweep in sweeps.items()
    }


def test_among_decoys_the_right_ones_are_chosen_with_closed_images(decoyed):
    found = calibrated(decoyed)
    each = decoyed.detections.points_each
    right = np.repeat(decoyed.right, each)
    assert (found.chosen & right).sum() >= 0.95 * right.sum()
    assert (found.chosen & ~right).sum() <= 0.05 * found.chosen.sum()
    angle, distance, _ = similarity_errors(found.calibration.probe_from_image, decoyed.probe_from_image)
    assert np.degrees(angle) < 1.5
    assert distance < 2.5
    assert found.sightings == 60
    assert found.used + sum(found.reasons.values()) == 60


def assert_same(found, expected, atol=1e-12):
    np.testing.assert_allclose(
        found.probe_from_image.matrix, expected.probe_from_image.matrix, atol=atol, rtol=0
    )
    np.testing.assert_allclose(found.covariance, expected.covariance, atol=atol, rtol=1e-6)
    np.testing.assert_array_equal(found.inlier, expected.inlier)


def test_a_recording_is_calibrated_as_the_observations_that_are_written_of_it(decoyed):
    found = calibrated(decoyed)
    rows = parse_observations(observations_csv(found.observations), "observations.csv")
    again = sc.calibrate(rows, image_size_px=decoyed.recording.image.size_px)
    assert_same(again, found.calibration)
    assert again.fit == found.calibration.fit


def test_where_the_tracker_stands_and_the_marker_of_the_needle_have_no_say(decoyed):
    found, rng = calibrated(decoyed), np.random.default_rng(0)
    moved = with_tracker_moved(decoyed.recording, random_poses(rng, 1)[0])
    assert_same(calibrated(replace(decoyed, recording=moved)).calibration, found.calibration, 1e-6)
    needle_from_marker = random_poses(rng, 1)[0]
    moved = with_marker_moved(decoyed.recording, "Needle", needle_from_marker)
    (line,) = decoyed.lines
    ends = (line.segment_mm - needle_from_marker[:3, 3]) @ needle_from_marker[:3, :3]
    other = replace(decoyed, recording=moved, lines=(replace(line, segment_mm=ends),))
    assert_same(calibrated(other).calibration, found.calibration, 1e-6)


def test_moving_the_probe_s_marker_moves_the_calibration_with_it(decoyed):
    probe_from_marker = random_poses(np.random.default_rng(1), 1)[0]
    moved = with_marker_moved(decoyed.recording, "Probe", probe_from_marker)
    found = calibrated(replace(decoyed, recording=moved)).calibration.probe_from_image.matrix
    expected = calibrated(decoyed).calibration.probe_from_image.matrix
    np.testing.assert_allclose(probe_from_marker @ found, expected, atol=1e-6)


def test_detections_in_another_order_give_the_same_choice(decoyed):
    """Within an image their rank is what counts, and it stays with them."""
    rng, found = np.random.default_rng(2), calibrated(decoyed)
    frames = rng.permutation(len(decoyed.recording))
    order = np.concatenate([np.flatnonzero(decoyed.detections.frame == frame) for frame in frames])
    other = calibrated(replace(decoyed, detections=decoyed.detections.select(order)))
    assert other.used == found.used
    assert_same_places(other.observations, found.observations)
    np.testing.assert_allclose(
        other.calibration.probe_from_image.matrix, found.calibration.probe_from_image.matrix, atol=1e-6
    )


def assert_same_places(found, expected):
    both = [rows.points_px[np.lexsort((*rows.points_px.T, rows.frame))] for rows in (found, expected)]
    np.testing.assert_array_equal(*both)


def test_given_points_and_a_table_of_them_are_one(decoyed):
    right = replace(decoyed, detections=decoyed.detections.select(decoyed.right))
    found, rows = calibrate_points(right.recording, right.lines, right.detections)
    table = tabulate(right.recording, right.lines, right.detections).observations
    assert_same(sc.calibrate(table, image_size_px=right.recording.image.size_px), found)
    np.testing.assert_array_equal(rows.points_px, table.points_px)


def counted(monkeypatch):
    """How often rows are fitted for choosing, and how often calibrated."""
    counts = {"best_fit": 0, "calibrate": 0}

    def count(module, name):
        own = getattr(module, name)

        def counting(*arguments, **keywords):
            counts[name] += 1
            return own(*arguments, **keywords)

        monkeypatch.setattr(module, name, counting)

    count(candidates, "best_fit")
    count(choice, "calibrate")
    return counts


def test_what_is_chosen_is_calibrated_once_and_nothing_is_fitted_twice(decoyed, monkeypatch):
    counts = counted(monkeypatch)
    calibrated(decoyed)
    assert counts["calibrate"] == 1
    assert counts["best_fit"] <= 5


def test_where_there_is_nothing_to_choose_among_two_fits_do(monkeypatch):
    """One of all, one of those that are near: all of them."""
    counts = counted(monkeypatch)
    scan = scan_of(2, 40, sigma_px=0.3, sigma_mm=0.1)
    assert calibrated(scan).used == 40
    assert counts == {"best_fit": 2, "calibrate": 1}


def test_a_second_look_that_finds_nothing_fits_nothing_again(monkeypatch):
    counts = counted(monkeypatch)
    scan = scan_of(2, 40, sigma_px=0.3, sigma_mm=0.1)
    rows = tabulate(scan.recording, scan.lines, scan.detections).observations
    found = calibrate_candidates(rows, look_again=lambda *_: None)
    assert found.used == 40
    assert counts == {"best_fit": 2, "calibrate": 1}


def test_how_well_echoes_are_placed_has_no_say(decoyed):
    """A needle bends and sound is refracted: the image's noise is that of the residuals."""
    sure = replace(decoyed.detections, covariance_px2=1e-4 * decoyed.detections.covariance_px2)
    found, expected = calibrated(replace(decoyed, detections=sure)), calibrated(decoyed)
    assert_same(found.calibration, expected.calibration, 0.0)
    assert found.observations.sigma_px is None


def test_the_options_are_kept_with_the_result(decoyed):
    found = calibrated(decoyed, tolerance_mm=3, seed=5)
    assert isinstance(found.options, Options)
    assert (found.options.tolerance_mm, found.options.seed, found.options.second_look) == (3, 5, False)
    assert found.options.threshold_mm == found.calibration.threshold_mm == 5.0
    assert found.calibration.options.image_size_px == decoyed.recording.image.size_px


def test_the_noise_may_tell_the_threshold(decoyed):
    """Among the rows that were chosen; choosing takes what tells lines apart."""
    found, told = calibrated(decoyed, threshold_mm="auto"), calibrated(decoyed)
    np.testing.assert_array_equal(found.chosen, told.chosen)
    assert found.options.threshold_mm == "auto"
    residuals = told.calibration.residuals_mm
    deviation = np.median(residuals) / 1.1774
    assert 2.5 * deviation < found.calibration.threshold_mm < min(5.0, 4.2 * deviation)
    assert found.calibration.fit.inliers >= 0.9 * len(found.observations)
    angle, distance, _ = similarity_errors(found.calibration.probe_from_image, decoyed.probe_from_image)
    assert np.degrees(angle) < 1.5
    assert distance < 2.5


def test_what_the_noise_tells_stays_below_what_tells_candidates_apart():
    """Noise so large that its threshold would take one wire for the next."""
    scan = scan_of(2, 120, seed=1, sigma_px=8.0, sigma_mm=2.0)
    rows = tabulate(scan.recording, scan.lines, scan.detections).observations
    assert sc.calibrate(rows, threshold_mm="auto").threshold_mm > 5.0
    found = calibrate_candidates(rows, threshold_mm="auto")
    assert found.calibration.threshold_mm == 5.0


@DIMENSIONS
def test_a_latency_is_undone_once_and_kept(dimension):
    """A tracker whose stamps are one image late: its calibration is that of one in time, to the last bit."""
    scan, item_s = scan_of(dimension, 30, seed=4), 0.125
    late = {name: rolled(one) for name, one in scan.recording.poses.items()}
    late = replace(scan.recording, poses=late)
    undone = with_latency(late, item_s)
    assert (late.latency_s, undone.latency_s) == (0.0, item_s)
    assert undone.select(np.arange(9)).latency_s == item_s
    seen = scan.detections.select(scan.detections.frame < 29)
    found, expected = (
        calibrate_points(recording, scan.lines, seen)[0] for recording in (undone, scan.recording)
    )
    assert_same(found, expected)
    assert (found.latency_s, expected.latency_s) == (item_s, None)
    found = calibrate_recording(undone, scan.lines, detections=scan.detections, second_look=False)
    assert found.calibration.latency_s == item_s
    with pytest.raises(sc.InputError) as caught:
        with_latency(undone, 0.25)
    assert str(caught.value) == (
        "recording: its poses were moved by a latency of 0.125 s before, and now 0.25 s are given; give it once, to "
        "the recording as it was read"
    )


def rolled(poses):
    """The poses that a tracker one item late stamps."""
    return Poses.of(poses.source, poses.target, np.roll(poses.matrices, 1, axis=0))


@DIMENSIONS
def test_detecting_before_or_in_the_call_is_one(swept, dimension):
    sweep = swept[dimension]
    found = calibrate_recording(sweep.recording, sweep.lines)
    steps = []
    again = calibrate_recording(
        sweep.recording,
        sweep.lines,
        detections=detect(sweep.recording),
        progress=lambda *at: steps.append(at),
    )
    assert_same(again.calibration, found.calibration, 0.0)
    assert again.reasons == found.reasons
    assert steps == []
    assert found.calibration.diagnostics == again.calibration.diagnostics
    codes = [one.code for one in found.calibration.diagnostics]
    assert codes.count("images-used") == 1


@DIMENSIONS
def test_images_and_volumes_calibrate_with_nobody_clicking(swept, dimension):
    sweep = swept[dimension]
    found = calibrate_recording(sweep.recording, sweep.lines)
    size = np.array(sweep.recording.image.size_px)
    places = np.random.default_rng(0).uniform(0.2, 0.8, (20, dimension)) * size
    missed = found.calibration.probe_from_image @ places - sweep.truth.probe_from_image @ places
    assert np.sqrt((missed**2).sum(axis=1).mean()) < 1.5
    assert np.isin(found.observations.frame, np.flatnonzero(sweep.truth.visible)).mean() > 0.95


@DIMENSIONS
def test_where_nothing_was_found_the_refusal_says_how_much_was_looked_at(dimension):
    scan = scan_of(dimension, 20)
    nothing = replace(scan.detections.select([]), images=20)
    with pytest.raises(sc.NoConsensusError, match="recording: no candidate was found in 20 images"):
        calibrate_recording(scan.recording, scan.lines, detections=nothing)


@DIMENSIONS
def test_decoys_alone_agree_on_nothing(dimension):
    scan = scan_of(dimension, 60, decoys=3, hidden=1.0)
    with pytest.raises(sc.NoConsensusError, match=r"240 candidates in 60 images were tried"):
        calibrated(scan)


def test_a_recording_without_images_is_refused():
    scan = scan_of(frames=False)
    with pytest.raises(sc.InputError, match="has no images to look for a needle in"):
        calibrated(scan)


def test_mm_per_px_that_the_recording_states_are_compared(decoyed):
    """Unless the user says others."""
    image = decoyed.recording.image
    right = float(decoyed.probe_from_image.scale)

    def codes(factor, **options):
        spacing = (factor * right,) * image.dimension
        stated = replace(
            decoyed, recording=replace(decoyed.recording, image=replace(image, spacing_mm=spacing))
        )
        found = calibrated(stated, **options).calibration
        return [one for one in found.warnings if one.code == "scale-differs-from-scanner"]

    assert codes(1.0) == []
    (finding,) = codes(1.1)
    assert "the calibration has" in finding.message
    assert "and the recording (its header) says" in finding.message
    assert finding.advice.startswith("both axes differ alike")
    assert codes(1.1, scanner_mm_per_px=right) == []
