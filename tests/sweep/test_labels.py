"""Candidates that may each be of any of several lines, in images and volumes: labelled, calibrated, or refused."""

import numpy as np
import pytest
from benchmarks.simulators import phantoms

import sonocal as sc
from sonocal.observations import Observations
from sonocal.sweep.choice import calibrate_candidates


def candidates_of(dots):
    """Each dot, or each line of a volume by its ends, against every wire, frame by frame."""
    frame, target, points, segments, split = [], [], [], [], []
    volumes = dots.points.ndim == 3
    for number in range(len(dots.wires)):
        here = np.flatnonzero(dots.frame == number)
        for wire in range(dots.wires.shape[1]):
            for rank, row in enumerate(here):
                for point in np.atleast_2d(dots.points[row]):
                    frame.append(number)
                    target.append(f"wire {wire}")
                    points.append(point)
                    segments.append(dots.wires[number, wire])
                    split.append(str(rank) if volumes else "")
    return Observations(
        frame=np.array(frame),
        target=np.array(target),
        points_px=np.array(points),
        segments_mm=np.array(segments),
        split=np.array(split),
        image_size_px=(500,) * dots.points.shape[-1],
    )


def truth_of(rows, dots):
    """The true wire of each row."""
    ends = dots.points.reshape(len(dots.points), -1, dots.points.shape[-1])
    known = {
        (f, *point): wire
        for f, both, wire in zip(dots.frame, ends.tolist(), dots.truth, strict=True)
        for point in both
    }
    return [f"wire {known[(f, *p)]}" for f, p in zip(rows.frame, rows.points_px.tolist(), strict=True)]


def scans(seed):
    rng = np.random.default_rng(seed)
    return {
        "wires in volumes": phantoms.scan_volumes(rng, phantoms.random_wires(rng, 6), 20),
        "needles in volumes": phantoms.scan_needles(rng, 2, 30, volumes=True),
        "needles in images": phantoms.scan_needles(rng, 2, 30),
        "a needle among wires": phantoms.scan_needles(rng, 1, 30, wires=phantoms.random_wires(rng, 5)),
    }


@pytest.mark.parametrize("what", list(scans(0)))
def test_lines_that_nobody_names_are_labelled_and_calibrated_on(what):
    rng = np.random.default_rng(1)
    dots = phantoms.spoilt(rng, scans(1)[what], 0.1, 0.3)
    found = calibrate_candidates(candidates_of(dots))
    rows = found.observations.select(found.calibration.inlier)
    right = rows.target == np.array(truth_of(rows, dots))
    assert right.mean() >= 0.98
    each = len(rows) // len(np.unique(np.column_stack([rows.frame, rows.target]), axis=0))
    assert right.sum() >= 0.8 * each * np.count_nonzero(dots.truth >= 0)
    codes = {one.code for one in found.calibration.diagnostics}
    assert "labels-given" in codes and not codes & {"labels-ambiguous", "labels-unfinished"}
    # Pictures of numbered dots are of images.
    assert (found.labels is None) == (dots.points.ndim == 3)


@pytest.mark.parametrize("scan", [phantoms.scan, phantoms.scan_volumes])
def test_a_hexagon_scanned_along_its_wires_is_refused_or_said_to_be_ambiguous(scan):
    rng = np.random.default_rng(6)
    dots = scan(rng, phantoms.symmetric(rng), 20, turn_rad=0.002, shift_mm=(0.3, 0.3, 20.0))
    try:
        found = calibrate_candidates(candidates_of(dots))
    except sc.SonocalError:
        return
    assert "labels-ambiguous" in {one.code for one in found.calibration.diagnostics}


def test_few_candidates_of_which_none_is_sure_are_refused_by_what_is_open():
    rng = np.random.default_rng(3)
    dots = phantoms.scan_volumes(rng, phantoms.symmetric(rng), 6, turn_rad=0.01)
    dots = phantoms.spoilt(rng, dots, 0.75, 0.0)
    with pytest.raises(sc.SonocalError, match=r"ambiguous|ended early|no labels|direction"):
        calibrate_candidates(candidates_of(dots), sightings=100)
