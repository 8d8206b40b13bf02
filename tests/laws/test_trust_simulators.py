"""The simulators that judge: what they make is what they say, without noise and with the fault alone."""

import re
from pathlib import Path

import numpy as np
import pytest
from benchmarks import trust
from benchmarks.simulators import trust_faults, trust_scans
from benchmarks.simulators.trust_faults import KINDS
from benchmarks.simulators.trust_judge import Outcome, judged, recording, table
from benchmarks.simulators.trust_power import best_power, deflection, shown
from benchmarks.simulators.trust_sound import COVERAGE, SOUND

SCANS = {
    "2D": trust_scans.clean,
    "3D": lambda seed: trust_scans.clean(seed, 30, 3),
    "stills": lambda seed: trust_scans.clean(seed, still=True),
    "port": lambda seed: trust_scans.through_port(seed, 50, 3.0, 60.0),
    "plane": lambda seed: trust_scans.in_plane(seed, 50),
    "direction": lambda seed: trust_scans.one_direction(seed, 50, 1.0),
    "area": lambda seed: trust_scans.points_within(seed, 50, 40, 20),
    "wires": lambda seed: trust_scans.wires(seed, 50, 3),
}


def distances(scan):
    """(N, P): from what is seen, mapped by the truth, to the line."""
    segments = scan.segments_mm()
    along = segments[:, 1] - segments[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    off = trust_scans.mapped(scan.truth, scan.points_px) - segments[:, :1]
    return np.linalg.norm(np.cross(off, along[:, None]), axis=2)


@pytest.mark.parametrize("name", SCANS)
@pytest.mark.parametrize("seed", range(3))
def test_without_noise_every_point_lies_on_its_line(name, seed):
    scan = SCANS[name](seed)
    assert len(scan.time_s) > 20
    assert distances(scan).max() < 1e-9


def test_a_table_and_a_recording_of_a_scan_hold_the_same_lines():
    scan = trust_scans.clean(1)
    poses = recording(scan).between("Probe", "Needle").matrices
    ends = trust_scans.carried(poses, np.array([[[0, 0, 0], [0, 0, -trust_scans.NEEDLE_MM]]] * len(poses)))
    np.testing.assert_allclose(ends, table(scan).segments_mm, atol=1e-9)


def test_a_stretched_image_keeps_its_truth():
    scan = trust_scans.clean(2, 30, 3)
    assert distances(trust_faults.stretched(scan, 2, 0.9)).max() < 1e-9


@pytest.mark.parametrize("axis", range(3))
def test_the_truth_of_a_mirrored_volume_is_mirrored(axis):
    truth = trust_faults.mirrored_volume(3, axis).scan.truth
    assert np.linalg.det(truth[:3, :3]) < 0
    assert np.median(distances(trust_faults.mirrored_volume(3, axis).scan)) < 2


def test_correlated_errors_have_unit_variance_and_forget_in_their_time():
    values = trust_faults.correlated(np.random.default_rng(0), 4000, 5.0, 20)
    assert values.var() == pytest.approx(1, rel=0.05)
    assert np.mean(values[5:] * values[:-5]) == pytest.approx(np.exp(-1), abs=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_a_marker_that_moved_is_off_by_what_it_moved(seed):
    case = trust_faults.offset_in_probe(seed, 50.0)
    moved = case.scan.segments_mm() - trust_scans.sound(seed).segments_mm()
    np.testing.assert_allclose(np.linalg.norm(moved, axis=2), 50.0, atol=1e-9)


@pytest.mark.parametrize("name", KINDS)
def test_a_seed_of_every_kind_is_judged_at_its_first_and_last_strength(name):
    strengths = KINDS[name].strengths
    for strength in {strengths[0], strengths[-1]}:
        outcome = judged(KINDS[name].make(5, strength))
        assert outcome.level in {"refused", "stop", "care", "use"}
        assert (outcome.level == "refused") == bool(np.isnan(outcome.error_mm))


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_of_one_seed_is_one_scan(name):
    first, second = (KINDS[name].make(6, KINDS[name].strengths[0]).scan for _ in range(2))
    np.testing.assert_array_equal(first.points_px, second.points_px)
    np.testing.assert_array_equal(first.ends_mm, second.ends_mm)


@pytest.mark.parametrize("name", SOUND)
def test_a_sound_scan_has_as_many_sightings_as_asked_and_lies_on_its_lines(name):
    case = SOUND[name](7, 20)
    assert np.median(distances(case.scan)) < 3


def test_confidently_wrong_is_silent_and_three_times_off():
    assert Outcome("use", (), 3.1, 1.0).confidently_wrong
    assert not Outcome("use", (), 2.9, 1.0).confidently_wrong
    assert not Outcome("care", ("latency",), 3.1, 1.0).confidently_wrong


def test_a_large_bound_alone_is_no_accusation():
    assert not Outcome("care", ("weak-motion",), 1.0, 3.0).accused
    assert Outcome("care", ("weak-motion", "latency"), 1.0, 3.0).accused
    assert Outcome("refused", ("coplanar-lines",)).accused


def test_the_tables_replace_those_between_a_page_s_markers(tmp_path, capsys):
    page = tmp_path / "trust.md"
    page.write_text("Before.\n<!-- coverage: begin -->\nold\n<!-- coverage: end -->\nAfter.\n")
    trust.main(["--rows", "coverage port of 5", "--seeds", "2", "--jobs", "1", "--write", str(page)])
    text = page.read_text()
    assert "old" not in text
    assert re.search(r"^\| port of 5 mm \| 2 \|", text, re.M)
    assert text.startswith("Before.") and text.endswith("After.\n")
    assert "| port of 5 mm | 2 |" in capsys.readouterr().out


def test_the_page_has_a_place_for_every_table_and_names_what_cannot_be_known():
    page = (Path(trust.__file__).parents[1] / "docs" / "trust.md").read_text()
    for part in trust.HEADS:
        assert f"<!-- {part}: begin -->" in page
        assert f"<!-- {part}: end -->" in page
    for kind in KINDS.values():
        assert kind.unknowable in page


def test_every_row_is_of_a_known_table():
    rows = list(trust.all_rows())
    assert len(rows) == 3 * len(KINDS) + len(SOUND) * len(trust.SIGHTINGS) + len(COVERAGE)


@pytest.mark.parametrize("name", [name for name, kind in KINDS.items() if kind.nothing is not None])
def test_a_fault_deflects_the_best_test_by_its_strength_and_none_does_not(name):
    kind, strength = KINDS[name], KINDS[name].strengths[0]
    assert deflection(name, kind.nothing, 3) < 1e-9
    weak, weaker = (deflection(name, x * strength, 3) for x in (0.02, 0.01))
    assert weak == pytest.approx(2 * weaker, rel=0.2)


def test_what_the_calibration_takes_up_deflects_no_test():
    assert deflection("offset in the probe's frame", 4.0, 3) < 0.1
    assert shown("offset in the tracker's frame", deflection("offset in the tracker's frame", 4.0, 3))


@pytest.mark.parametrize("name", ["unequal pixels", "needle sags"])
def test_the_best_test_has_its_false_alarms_and_what_is_not_shown_is_missed(name):
    assert best_power(name, 0.0) == pytest.approx(0.01)
    assert best_power("unequal pixels", 5.7) == pytest.approx(0.999, abs=5e-4)
    assert not shown(name, 5.6)
    assert shown(name, 8.0)


def test_who_knows_a_fault_by_its_form_finds_more():
    """A table without poses has many forms of one offset in the tracker's frame."""
    powers = [best_power(name, 4.0) for name in ("unequal pixels", "needle sags")]
    assert powers[0] > 1.5 * powers[1]


@pytest.mark.parametrize("freedom", [1, 21])
def test_the_power_is_that_of_a_sum_of_squares(freedom):
    name = {1: "unequal pixels", 21: "needle sags"}[freedom]
    rng = np.random.default_rng(1)
    squares = rng.normal(size=(200_000, freedom))
    limit = np.quantile(np.sum(squares**2, axis=1), 0.99)
    squares[:, 0] += 4.0
    assert np.mean(np.sum(squares**2, axis=1) > limit) == pytest.approx(best_power(name, 4.0), abs=0.01)
