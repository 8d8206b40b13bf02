"""Crossings, floors, and several targets at once whose place nobody knows, found among what images show."""

import numpy as np
import pytest
from benchmarks.simulators.places import image_corners

import sonocal as sc
from sonocal.targets import Line, Unplaced
from sonocal.targets.unplaced import target_of
from tests.builders.bath import anywhere, bath, crossing, seen, shown

FRAMES = 80
ASIDE = np.array([30.0, 20.0, -18.0])


def worst_mm(found, scene):
    there = image_corners() @ scene.truth[:3, :3].T + scene.truth[:3, 3]
    return np.linalg.norm(found.probe_from_image @ image_corners() - there, axis=1).max()


def off_mm(found, place):
    """Of where a line was found from where it is, in the middle of what was seen."""
    along = (place[1] - place[0]) / np.linalg.norm(place[1] - place[0])
    return np.linalg.norm(np.cross(found.middle_mm - place[0], along))


@pytest.mark.parametrize(("kind", "each", "most_mm"), [("point", 1, 1.0), ("plane", 2, 4.0)])
def test_a_crossing_and_a_floor_are_found_among_other_things(kind, each, most_mm):
    recording, scene = bath(kind)
    what = seen(shown(scene, each), anywhere(FRAMES, 2, each=each), images=FRAMES, swapped=0.2)
    found = sc.calibrate_recording(recording, [Unplaced(kind, "it", "Tracker")], detections=[what])
    assert worst_mm(found.calibration, scene) < most_mm
    assert found.used > 0.9 * FRAMES
    assert found.calibration.targets["it"].kind == kind
    assert "images-used" in [one.code for one in found.calibration.diagnostics]
    assert set(found.observations.target) == {"it"}


def test_a_point_that_lies_anywhere_is_no_crossing():
    recording, _ = bath("point")
    with pytest.raises((sc.NoConsensusError, sc.DegenerateGeometryError)):
        sc.calibrate_recording(
            recording,
            [Unplaced("point", "it", "Tracker")],
            detections=[seen(anywhere(FRAMES, 1), images=FRAMES)],
        )


@pytest.fixture(scope="module")
def two_threads():
    recording, scene = bath("line", 120)
    turned = np.roll(scene.place[1] - scene.place[0], 1) * [1, -1, 0.2]
    other = scene.place[0] + ASIDE + np.array([0 * turned, turned])
    what = seen(shown(scene), crossing(scene, other), anywhere(120, 1), images=120, swapped=0.4)
    return recording, scene, other, what


def threads(recording, detections, *targets):
    return sc.calibrate_recording(recording, targets, detections=[detections], second_look=False)


def test_of_two_threads_either_gives_the_calibration(two_threads):
    recording, scene, other, what = two_threads
    found = threads(recording, what, Unplaced("line", "thread", "Tracker")).calibration
    assert worst_mm(found, scene) < 2
    assert min(off_mm(found.targets["thread"], place) for place in (scene.place, other)) < 1


def test_two_threads_at_once_are_told_apart(two_threads):
    recording, scene, other, what = two_threads
    asked = [Unplaced("line", name, "Tracker") for name in ("a", "b")]
    found = threads(recording, what, *asked).calibration
    one = threads(recording, what, asked[0]).calibration
    assert worst_mm(found, scene) < 1.5
    assert found.predicted_errors()[2].max() < one.predicted_errors()[2].max()
    off = np.array([[off_mm(found.targets[name], place) for name in "ab"] for place in (scene.place, other)])
    assert min(off[0, 0] + off[1, 1], off[0, 1] + off[1, 0]) < 1


def test_a_known_thread_beside_an_unknown_one(two_threads):
    recording, scene, other, what = two_threads
    asked = [Line("known", "Tracker", other), Unplaced("line", "thread", "Tracker")]
    found = threads(recording, what, *asked)
    assert worst_mm(found.calibration, scene) < 1.5
    assert list(found.calibration.targets) == ["thread"]
    assert off_mm(found.calibration.targets["thread"], scene.place) < 0.5
    assert set(found.observations.target) == {"known", "thread"}


def test_threads_that_are_roughly_known_keep_their_names(two_threads):
    recording, scene, other, what = two_threads
    asked = [
        Unplaced("line", name, "Tracker", place + np.array([1.0, 1.0, 0.5]), 2.0, 1.0)
        for name, place in (("one", other), ("two", scene.place))
    ]
    found = threads(recording, what, *asked).calibration
    assert off_mm(found.targets["one"], other) < 0.5
    assert off_mm(found.targets["two"], scene.place) < 0.5


def test_a_target_that_is_not_there_is_said_by_name(two_threads):
    recording, scene, _, _ = two_threads
    what = seen(shown(scene), anywhere(120, 1), images=120)
    asked = [Unplaced("line", name, "Tracker") for name in ("a", "b")]
    with pytest.raises(sc.NoConsensusError, match="no place of the line 'b' agrees with more than"):
        threads(recording, what, *asked)


def test_what_was_found_is_a_target_of_its_kind():
    recording, scene = bath("point")
    what = seen(shown(scene), images=FRAMES)
    found = sc.calibrate_recording(recording, [Unplaced("point", "it", "Tracker")], detections=[what])
    place = found.calibration.targets["it"].spanning_mm
    known = target_of("point", "it", "Tracker", np.array(place))
    again = sc.calibrate_recording(recording, [known], detections=[what]).calibration
    np.testing.assert_allclose(
        again.probe_from_image @ image_corners(),
        found.calibration.probe_from_image @ image_corners(),
        atol=3 * found.calibration.predicted_errors()[2].max(),
    )
