"""A second look, with a detector that says what it was asked."""

from dataclasses import replace

import numpy as np
import pytest

from sonocal.detection import DetectionOptions
from sonocal.detection.recordings import Detector
from sonocal.geometry import image_crossings
from sonocal.sweep import calibrate_candidates, tabulate
from sonocal.sweep.second_look import LAST_RANK, SecondLook
from sonocal.sweep.tabulate import Posing
from sonocal.targets import Line
from tests.builders.sweeps import NEEDLE, scan_of

OTHER = Line("other", "Needle", np.array([[40.0, 0.0, 0.0], [40.0, 0.0, -400.0]]))


class FakeDetector(Detector):
    """Finds what it is told to, and keeps what it was asked for."""

    def __init__(self, recording, find):
        super().__init__(recording, DetectionOptions())
        self.find, self.asked = find, []

    def everywhere(self, image, name):
        raise AssertionError("a first look")

    def near(self, frame, needle_px, reach_px):
        self.asked.append((frame, needle_px, reach_px))
        return self.find(frame, needle_px)


def nothing(dimension):
    return lambda frame, needle: np.empty((0, dimension - 1, dimension))


def on_needle(dimension):
    """Where the needle is: its crossing of the image, or two points of it."""
    return lambda frame, needle: image_crossings(needle[None])[None] if dimension == 2 else needle[None] / 2


def looked(scan, find, lines=None, near=None):
    detector, lines = FakeDetector(scan.recording, find), lines or scan.lines
    segments = Posing().segments_mm(scan.recording, lines)
    look = SecondLook(detector, lines, segments, scan.detections)
    if near is None:
        near = tabulate(scan.recording, lines, scan.detections).observations
    return detector, look(scan.probe_from_image, near, 4.8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_only_sightings_that_have_no_candidate_are_looked_at_again(dimension):
    scan = scan_of(dimension, 12, hidden=0.4)
    missing = sorted(set(range(12)) - set(scan.detections.frame.tolist()))
    detector, further = looked(scan, nothing(dimension))
    assert [frame for frame, _, _ in detector.asked] == missing
    assert {reach for _, _, reach in detector.asked} == {4.8 / scan.probe_from_image.scales[0]}
    assert further is None


@pytest.mark.parametrize("dimension", [2, 3])
def test_it_is_asked_where_the_calibration_puts_the_needle(dimension):
    scan = scan_of(dimension, 8, hidden=0.5, sigma_px=0, sigma_mm=0)
    seen = scan_of(dimension, 8, sigma_px=0, sigma_mm=0)  # the same needle, in every image
    detector, _ = looked(scan, nothing(dimension))
    for frame, needle, _ in detector.asked:
        places = np.zeros((dimension - 1, 3))
        places[:, :dimension] = seen.detections.points_px[frame]
        along = (needle[1] - needle[0]) / np.linalg.norm(needle[1] - needle[0])
        np.testing.assert_allclose(np.cross(places - needle[0], along), 0, atol=1e-5)


def test_images_without_a_pose_or_marked_invalid_are_not_looked_at():
    scan = scan_of(2, 10, hidden=1.0)
    needle = scan.recording.poses["tracker_from_needle"]
    lost = replace(needle, valid=np.arange(10) % 2 == 0)
    recording = replace(
        scan.recording,
        poses={**scan.recording.poses, needle.name: lost},
        image_valid=np.arange(10) % 3 > 0,
    )
    near = tabulate(scan.recording, scan.lines, scan_of(2, 10).detections).observations
    near = near.select(near.frame < 0)
    detector, _ = looked(replace(scan, recording=recording), nothing(2), near=near)
    assert [frame for frame, _, _ in detector.asked] == [2, 4, 8]


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_is_found_is_of_the_needle_that_was_asked_for(dimension):
    scan = scan_of(dimension, 12, hidden=0.5)
    lines = (NEEDLE, OTHER)
    near = tabulate(scan.recording, (NEEDLE,), scan.detections).observations
    detector, further = looked(scan, on_needle(dimension), lines, near)
    asked = [frame for frame, _, _ in detector.asked]
    assert len(asked) == 2 * 12 - len(scan.detections)
    assert np.repeat(asked, dimension - 1).tolist() == further.frame.tolist()
    for frame in range(12):
        names = further.target[further.frame == frame].tolist()
        seen = frame in scan.detections.frame
        assert list(dict.fromkeys(names)) == (["other"] if seen else ["needle", "other"])
    assert further.split.tolist() == (
        [""] * len(further) if dimension == 2 else [str(LAST_RANK)] * len(further)
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_the_first_look_found_is_not_found_again(dimension):
    """It belongs to another needle, or was not near enough."""
    scan = scan_of(dimension, 10)
    known = scan.detections
    rows = tabulate(scan.recording, scan.lines, known).observations
    none_near = rows.select(rows.frame < 0)
    detector, further = looked(scan, lambda frame, _: known.points_px[known.frame == frame], near=none_near)
    assert len(detector.asked) == 10
    assert further is None


def test_a_needle_found_again_takes_part():
    scan, whole = (scan_of(2, 40, hidden=hidden, sigma_px=0.2, sigma_mm=0.1) for hidden in (0.5, 0.0))
    whole = whole.detections
    detector = FakeDetector(scan.recording, lambda frame, _: whole.points_px[whole.frame == frame])
    rows = tabulate(scan.recording, scan.lines, scan.detections).observations
    segments = Posing().segments_mm(scan.recording, scan.lines)
    look = SecondLook(detector, scan.lines, segments, scan.detections)
    once = calibrate_candidates(rows, sightings=40)
    twice = calibrate_candidates(rows, sightings=40, look_again=look)
    assert once.used == len(scan.detections)
    assert twice.used >= 39
    assert once.reasons == {"no candidate or no pose": 40 - once.used, "no candidate near the needle": 0}
    assert twice.reasons == {"no candidate or no pose": 0, "no candidate near the needle": 40 - twice.used}
    np.testing.assert_array_equal(once.chosen, twice.chosen)
