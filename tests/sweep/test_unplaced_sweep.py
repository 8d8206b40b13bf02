"""Recordings of a thread or a needle whose place nobody knows: found in images, with nobody clicking."""

import numpy as np
import pytest

import sonocal as sc
from sonocal.detection import Detections
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.sweep import calibrate_points
from sonocal.targets import Line, Unplaced
from tests.builders.tank import resting_in_room

NEEDLE = [Unplaced("line", "needle", "Needle")]
CORNERS = np.array([[0.0, 0], [499, 0], [0, 499], [499, 499]])


def worst_mm(found, truth):
    return np.linalg.norm(found.probe_from_image @ CORNERS - truth @ CORNERS, axis=1).max()


def given_points(sweep, **more):
    """The places that the images show, given."""
    seen = np.flatnonzero(sweep.truth.visible)
    return Detections.of_points(seen, sweep.truth.shown_px[seen], **more)


@pytest.fixture(scope="module")
def sweep():
    return simulate_sweep(options=SweepOptions(frames=120, sigma_mm=0.3, hidden_share=0.1, seed=2))


def test_a_thread_in_the_room_is_found_in_images(sweep):
    found = sc.calibrate_recording(resting_in_room(sweep.recording), [Unplaced("line", "thread", "Tracker")])
    assert worst_mm(found.calibration, sweep.truth.probe_from_image) < 2
    target = found.calibration.targets["thread"]
    assert abs(target.direction[2]) > 0.999  # the needle lies along its frame's z, through the origin
    assert np.linalg.norm(np.cross(target.middle_mm, target.direction)) < 2
    assert "images-used" in [one.code for one in found.calibration.diagnostics]
    assert found.used > 0.6 * found.sightings
    assert set(found.observations.target) == {"thread"}
    assert found.observations.lines_only


def test_points_given_against_a_needle_nobody_pivoted(sweep):
    found, rows = calibrate_points(sweep.recording, NEEDLE, given_points(sweep))
    assert worst_mm(found, sweep.truth.probe_from_image) < 2
    assert len(rows) == sweep.truth.visible.sum()
    known, _ = calibrate_points(sweep.recording, sweep.lines, given_points(sweep))
    np.testing.assert_allclose(
        found.probe_from_image @ CORNERS,
        known.probe_from_image @ CORNERS,
        atol=2 * found.predicted_errors()[2].max(),
    )


def test_a_known_needle_beside_the_unknown_is_taken_as_it_is(sweep):
    seen = np.flatnonzero(sweep.truth.visible)
    names = np.where(seen % 2 == 0, "needle", "other")
    targets = [*NEEDLE, Line("other", "Needle", sweep.lines[0].segment_mm)]
    found, rows = calibrate_points(sweep.recording, targets, given_points(sweep, target=names))
    assert list(found.targets) == ["needle"]
    assert worst_mm(found, sweep.truth.probe_from_image) < 2
    assert set(rows.target) == {"needle", "other"}


def test_a_lag_is_found_from_points_too():
    sweep = simulate_sweep(
        options=SweepOptions(frames=250, sigma_mm=0.3, latency_s=0.08, seed=6, hidden_share=0.0)
    )
    found, _ = calibrate_points(sweep.recording, NEEDLE, given_points(sweep), latency="estimate")
    assert found.latency_s == pytest.approx(0.08, abs=0.006)
    assert worst_mm(found, sweep.truth.probe_from_image) < 2


def test_what_cannot_be_is_refused_before_an_image_is_decoded(sweep):
    for lines, kind, said in [
        ([*NEEDLE, sweep.lines[0]], sc.InputError, "two targets are called 'needle'"),
        ([Unplaced("line", "thread", "Phantom")], sc.InputError, "Phantom"),
        ([*NEEDLE, Unplaced("plane", "floor", "Phantom")], sc.InputError, "Phantom"),
        ([*NEEDLE, "needle"], sc.InputError, "must be points, lines and planes; got 'needle'"),
    ]:
        with pytest.raises(kind, match=said):
            sc.calibrate_recording(sweep.recording, lines)
    with pytest.raises(sc.InputError, match="'wire' is none of the targets needle"):
        calibrate_points(
            sweep.recording, NEEDLE, given_points(sweep, target=np.full(sweep.truth.visible.sum(), "wire"))
        )


def test_what_is_seen_anywhere_is_no_thread(sweep):
    random = np.random.default_rng(0)
    frames = np.arange(120)
    anywhere = Detections.of_points(frames, random.uniform(50, 450, (120, 2)))
    with pytest.raises((sc.NoConsensusError, sc.DegenerateGeometryError)):
        sc.calibrate_recording(sweep.recording, NEEDLE, detections=anywhere)
