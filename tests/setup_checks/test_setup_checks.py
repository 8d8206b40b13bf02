"""Each wrong set-up is found on data made wrong in exactly that way, and sound data are left alone."""

import numpy as np
import pytest
from benchmarks.comparison import needle_scan
from benchmarks.simulators.faults import (
    FAULTS,
    altered,
    carried,
    evidence_of_sound,
    false_alarms,
    is_found,
    late,
    raised,
    sound,
)
from benchmarks.simulators.scans import scan
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.calibration import evidence_of, point_line_rows
from sonocal.errors import MirroredVolumeError
from sonocal.setup_checks import (
    check_flip,
    check_latency,
    check_scale,
    check_setup,
    check_slip,
    check_tool_frame,
)
from sonocal.setup_checks.lag_search import find_lag
from sonocal.setup_checks.rows_in_time import RowsInTime

SEEDS = range(20)
# Of 20 scans: found in at least, raised without cause in at most.
FOUND, FALSE = 19, 1


@pytest.mark.parametrize("dimension", [2, 3])
def test_sound_scans_are_left_alone(dimension):
    counts = false_alarms(dimension, SEEDS)
    assert max(counts.values()) <= FALSE, counts


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_set_up_is_found(fault):
    assert sum(is_found(fault, seed) for seed in SEEDS) >= FOUND


def test_a_marker_on_the_handle_of_a_sound_scan_is_no_flip():
    one = [sound(seed) for seed in SEEDS]
    findings = [
        list(check_flip(evidence_of(found, s.observations), marker_above_image=True)) for s, found in one
    ]
    assert sum(raised(f, "flipped-image") for f in findings) <= FALSE


@pytest.mark.parametrize(("latency_s", "who"), [(0.1, "tracker"), (-0.1, "image")])
def test_a_latency_says_who_is_late_and_is_no_slip(latency_s, who):
    findings = [late(seed, latency_s) for seed in SEEDS]
    assert sum(any(f"the {who} is late by " in f.message for f in found) for found in findings) >= FOUND
    assert sum(raised(found, "marker-slipped") for found in findings) <= FALSE


def test_a_mirrored_2d_image_alone_cannot_be_told_and_nothing_is_claimed():
    one, _ = sound(0)
    mirrored = altered(one.observations, points_px=[500, 0] + one.observations.points_px * np.array([-1, 1]))
    assert not list(check_flip(evidence_of(sc.calibrate(mirrored), mirrored)))


def test_the_frame_that_the_lines_are_in_is_named():
    one, _ = sound(1)
    wrong = carried(one.observations, one.tracker_from_probe)
    (finding,) = check_tool_frame(point_line_rows(wrong), tracker_from_probe=one.tracker_from_probe)
    assert "when the lines are taken to be in the tracker's frame" in finding.message


def test_a_latency_comes_out_in_ms_or_in_frames():
    one = scan(3, latency_s=0.1, outliers=0.0)
    found = sc.calibrate(one.observations)
    in_ms = next(check_latency(evidence_of(found, one.observations))).message
    in_frames = next(check_latency(evidence_of(found, altered(one.observations, extra={})))).message
    said = [float(message.split("late by ")[1].split()[0]) for message in (in_ms, in_frames)]
    assert said[0] == pytest.approx(100, rel=0.2)
    assert said[1] == pytest.approx(said[0] / 100, rel=1e-2)
    assert " ms (+-" in in_ms
    assert " frames (+-" in in_frames


def test_sound_real_data_raise_nothing(data_folder):
    for name in ("depth15_polaris", "trus_3nwires"):
        rows = sc.read_observations(data_folder / "observations" / f"{name}.csv").select_split("calibration")
        assert not check_setup(evidence_of(sc.calibrate(rows), rows)), name


@pytest.mark.parametrize("split", ["calibration", "validation"])
def test_two_real_recordings_of_one_probe_name_the_same_lag_and_no_slip(data_folder, split):
    """What passed for a drift: undone, the residuals fall from 0.52 and 0.55 to 0.31 mm rms in both."""
    table = sc.read_observations(data_folder / "observations" / "fcal12_ascension.csv")
    rows = table.select_split(split)
    lag = find_lag(RowsInTime.of(rows, point_line_rows(rows)), 5.0, "anisotropic")
    assert lag.value == pytest.approx(5.15, abs=0.3)
    assert np.sqrt(np.mean(lag.fit.residuals_mm[lag.fit.inlier] ** 2)) < 0.33
    found = check_setup(evidence_of(sc.calibrate(rows, model="anisotropic"), rows))
    assert [one.code for one in found] in ([], ["latency"])


def test_frames_in_any_order_hide_a_slip():
    """The finding is about time: the same rows in random order have nothing to find."""
    one = scan(0, slip=(np.radians([0, 2, 0]), np.array([4.0, 0, 0])))
    shuffled = altered(
        one.observations, frame=np.random.default_rng(0).permutation(len(one.observations)), extra={}
    )
    found = sc.calibrate(one.observations)
    assert raised(check_slip(evidence_of(found, one.observations)), "marker-slipped")
    assert not list(check_slip(evidence_of(found, shuffled)))


def test_few_frames_say_nothing_of_time():
    one, found = sound(0)
    few = one.observations.select(np.arange(12))
    assert not list(check_slip(evidence_of(found, few)))
    assert not list(check_latency(evidence_of(found, few)))


def test_nonsense_is_refused():
    evidence = evidence_of_sound(0)
    with pytest.raises(sc.InputError, match="scanner_mm_per_px must be positive; got -1"):
        list(check_scale(evidence, -1))
    with pytest.raises(
        sc.InputError, match=r"expected_rotation must be the directions of u, v and normal, shape \(3, 3\)"
    ):
        list(check_flip(evidence, expected_rotation=np.eye(4)))


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(5, 60),
    axis=st.integers(0, 2),
    outliers=st.sampled_from([0.0, 0.3]),
    threshold_mm=st.sampled_from([5.0, "auto"]),
)
def test_a_mirrored_volume_is_named_wherever_it_is_refused_or_spoilt(
    seed, count, axis, outliers, threshold_mm
):
    rng = np.random.default_rng(seed)
    truth = (Rotation.random(random_state=seed).as_matrix(), rng.uniform(-100, 100, 3))
    rows = needle_scan(rng, truth, 3, count)
    mirror = np.ones(3)
    mirror[axis] = -1
    points = 250 + (rows.points_px - 250) * mirror
    wrong = np.repeat(rng.random(count) < outliers, 2)
    points[wrong] = rng.uniform(0, 500, (wrong.sum(), 3))
    try:
        found = sc.calibrate(altered(rows, points_px=points), threshold_mm=threshold_mm)
    except MirroredVolumeError as refusal:
        assert "when it is mirrored along one axis" in str(refusal)
    except (sc.NoConsensusError, sc.DegenerateGeometryError) as refusal:
        assert "mirrored" in str(refusal) or wrong.sum() > 0.3 * len(wrong)  # too few are left
    else:
        assert "flipped-image" in {finding.code for finding in found.warnings} or wrong.mean() > 0.4
