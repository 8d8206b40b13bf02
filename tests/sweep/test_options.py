"""Every option of a recording's calibration is checked before the first image is decoded."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal import InputError, Line
from sonocal.sweep import Options, PointsOptions, calibrate_points, calibrate_recording
from sonocal.sweep.options import telling_threshold_mm
from tests.builders.sweeps import NEEDLE, scan_of

HOSTILE = [
    ({"treshold_mm": 3}, "'treshold_mm'.*'threshold_mm'"),
    ({"latency_s": 0.1}, "latency_s"),
    ({"candidates": None}, "candidates"),
    ({"threshold_mm": True}, "threshold_mm .*True"),
    ({"threshold_mm": -1.0}, "threshold_mm .*-1"),
    ({"threshold_mm": np.nan}, "threshold_mm .*nan"),
    ({"threshold_mm": "5 mm"}, "threshold_mm .*5 mm"),
    ({"model": "affine"}, "model must be one of similarity, anisotropic, rigid; got 'affine'"),
    ({"weighting": "none"}, "weighting must be one of"),
    ({"max_samples": 0}, "max_samples .*0"),
    ({"tolerance_mm": -2.0}, "tolerance_mm .*-2"),
    ({"sigma_px": 0.0}, "sigma_px .*0"),
    ({"image_size_px": (0, 4)}, "image_size_px .*0, 4"),
    ({"fit_split": "a"}, "fit_split is for tables; a recording has no splits, leave it out"),
    ({"test_split": "a"}, "test_split is for tables; a recording has no splits, leave it out"),
    ({"probe": None}, "probe must be the name of the probe's marker"),
    ({"on_invalid": "ignore"}, "on_invalid must be one of raise, skip; got 'ignore'"),
    ({"fixed": {("a", "b"): np.eye(3)}}, "fixed must map"),
]
OF_IMAGES = [
    ({"cuont": 3}, "'cuont'.*'count'"),
    ({"count": 0}, "count must be a whole number of candidates"),
    ({"count": "3"}, "count must be a whole number of candidates, 1 or more; got '3'"),
    ({"mask": np.ones((500, 500))}, "mask must be an array"),
    ({"mask": np.zeros((500, 500), dtype=bool)}, "the mask hides the whole image"),
    ({"centre": "middle"}, "centre must be one of head, mass; got 'middle'"),
    ({"second_look": "no"}, "second_look must be True or False; got 'no'"),
]


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("keywords", "sentence"), HOSTILE + OF_IMAGES)
def test_a_hostile_option_is_refused_before_an_image_is_decoded(dimension, keywords, sentence):
    scan = scan_of(dimension)  # its images raise when they are decoded
    with pytest.raises(InputError, match=sentence):
        calibrate_recording(scan.recording, scan.lines, **keywords)


@pytest.mark.parametrize(("keywords", "sentence"), HOSTILE)
def test_a_hostile_option_of_given_points_is_refused(keywords, sentence):
    scan = scan_of()
    with pytest.raises(InputError, match=sentence):
        calibrate_points(scan.recording, scan.lines, scan.detections, **keywords)


@pytest.mark.parametrize("name", ["count", "mask", "centre", "second_look"])
def test_what_is_for_detection_does_nothing_for_given_points_and_is_refused(name):
    scan = scan_of()
    with pytest.raises(InputError, match=name):
        calibrate_points(scan.recording, scan.lines, scan.detections, **{name: None})


@pytest.mark.parametrize(
    ("keywords", "lines", "sentence"),
    [
        ({"probe": "Sonde"}, [NEEDLE], "nothing connects Needle to Sonde"),
        ({}, [dataclasses.replace(NEEDLE, frame="Stylus")], "nothing connects Stylus to Probe"),
        ({}, [], "there is no line to look for"),
        ({}, [NEEDLE, NEEDLE], "two lines are called 'needle'"),
    ],
)
def test_lines_that_nothing_connects_to_the_probe_are_refused_before_an_image_is_decoded(
    keywords, lines, sentence
):
    with pytest.raises(InputError, match=sentence):
        calibrate_recording(scan_of().recording, lines, **keywords)


def test_a_pose_that_is_not_rigid_is_refused_before_an_image_is_decoded():
    recording = scan_of().recording
    needle = recording.poses["tracker_from_needle"]
    bent = dataclasses.replace(needle, matrices=needle.matrices * 1.1)
    recording = dataclasses.replace(recording, poses={**recording.poses, needle.name: bent})
    with pytest.raises(InputError, match="frame 0: NeedleToTracker is not rigid"):
        calibrate_recording(recording, [NEEDLE])


@pytest.mark.parametrize("number", [np.float32(4.0), np.float64(4.0), np.int64(4), 4])
def test_numpy_s_numbers_are_numbers(number):
    assert Options.of(threshold_mm=number, count=np.int64(3)).threshold_mm == 4.0


def test_options_are_frozen_and_comparable():
    options = Options.of(count=3, threshold_mm=2.0)
    assert options == Options.of(threshold_mm=2.0, count=3) != Options.of(count=4, threshold_mm=2.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        options.count = 5
    assert {one.name for one in dataclasses.fields(PointsOptions)} < {
        one.name for one in dataclasses.fields(Options)
    }


@pytest.mark.parametrize("dimension", [2, 3])
def test_errors_are_predicted_at_the_corners_of_the_recording_s_images(dimension):
    scan = scan_of(dimension)
    assert Options.for_lines(scan.recording, scan.lines).image_size_px == (500,) * dimension
    same, other = (500,) * dimension, (300,) * dimension
    assert Options.for_lines(scan.recording, scan.lines, image_size_px=same).image_size_px == same
    with pytest.raises(InputError, match="a recording knows its images"):
        Options.for_lines(scan.recording, scan.lines, image_size_px=other)
    alone = scan_of(dimension, frames=False).recording
    assert PointsOptions.for_recording(alone).image_size_px is None


def wire(offset_mm, name, frame="Phantom"):
    return Line(name, frame, np.array([[offset_mm, 0.0, 0.0], [offset_mm, 0.0, 60.0]]))


@given(st.lists(st.floats(0, 100), min_size=2, max_size=5, unique=True))
def test_wires_are_told_apart_by_a_fifth_of_their_distance(places):
    lines = [wire(place, f"wire {i}") for i, place in enumerate(places)]
    gap = np.diff(np.sort(places)).min()
    assert telling_threshold_mm(lines) == pytest.approx(np.clip(0.2 * gap, 1.0, 5.0), rel=1e-9)
    assert telling_threshold_mm(lines[::-1]) == telling_threshold_mm(lines)


def test_lines_of_different_tools_say_nothing_of_each_other():
    assert telling_threshold_mm([wire(0.0, "a"), wire(1.0, "b", "Needle")]) == 5.0
    assert telling_threshold_mm([NEEDLE]) == 5.0


def test_a_threshold_that_was_given_is_kept():
    scan, near = scan_of(), (wire(0.0, "a"), wire(10.0, "b"))
    assert Options.for_lines(scan.recording, near).threshold_mm == 2.0
    assert Options.for_lines(scan.recording, near, threshold_mm=None).threshold_mm == 2.0
    assert Options.for_lines(scan.recording, near, threshold_mm=4.0).threshold_mm == 4.0
    assert Options.for_lines(scan.recording, near, threshold_mm="auto").threshold_mm == "auto"


@pytest.mark.parametrize("name", ["needle.toml", Path("needle.toml")])
def test_who_gives_the_name_of_a_file_for_lines_is_told_how_to_read_it(name):
    recording = sc.Recording(times=np.arange(2.0), poses={})
    with pytest.raises(sc.InputError) as caught:
        sc.calibrate_recording(recording, name)
    assert str(caught.value) == (
        "lines must be a list of lines; got the name 'needle.toml': read them from the file with "
        "lines, fixed = sonocal.targets.read_lines(name)"
    )
