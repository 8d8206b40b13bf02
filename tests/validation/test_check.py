"""Whether a calibration still holds: the verdict, the power that it is told with, and the log."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.checks import first_day, knock, later
from benchmarks.simulators.trust_judge import image_size, table

import sonocal as sc
from sonocal.report import checks_html
from sonocal.validation import (
    CheckRecord,
    append_check,
    check_calibration,
    check_log_path,
    read_check_log,
)


@pytest.fixture(scope="module")
def known():
    scan = first_day(3)
    return sc.calibrate(table(scan), image_size_px=image_size(scan)), scan.truth


def checked(known, kind="needle", motion=None, grown=1.0, seed=3, **how):
    calibration, truth = known
    there = (np.eye(4) if motion is None else motion) @ truth
    there[:3, :3] *= grown
    return check_calibration(calibration, table(later(seed, there, kind, **how)))


@pytest.mark.parametrize("kind", ["needle", "phantom"])
def test_a_sound_calibration_is_not_said_to_have_changed(known, kind):
    found = checked(known, kind)
    assert found.verdict != "changed"
    assert found.moved_mm < 1.5
    assert 0 < found.power_least <= found.power_mean <= 1


@pytest.mark.parametrize("kind", ["needle", "thread", "phantom"])
@pytest.mark.parametrize(("mm", "deg"), [(3.0, 0.0), (0.0, 3.0), (30.0, 20.0)])
def test_a_knock_is_seen_with_its_size(known, kind, mm, deg):
    motion = knock(np.random.default_rng(5), mm, deg)
    found = checked(known, kind, motion)
    assert found.verdict == "changed"
    assert found.diagnostics[0].code == "calibration-changed"
    assert found.power(motion) > 0.99
    assert abs(found.turned_deg - deg) < 1.5


def test_another_depth_is_named(known):
    found = checked(known, grown=1.2)
    assert found.verdict == "changed"
    assert {"calibration-changed", "other-depth-setting"} <= {one.code for one in found.diagnostics}
    assert abs(found.scale_change - 0.2) < 0.03


@pytest.mark.parametrize("how", [{"seconds": 2.0}, {"still_probe": True}])
def test_a_sweep_that_tells_little_cannot_tell(known, how):
    found = checked(known, "thread", **how)
    assert found.verdict == "cannot tell"
    assert "check-too-weak" in {one.code for one in found.diagnostics}


def test_a_handful_of_sightings_tell_nothing(known):
    rows = table(later(3, known[1])).select(np.arange(5))
    found = check_calibration(known[0], rows)
    assert (found.verdict, found.rows, found.p_value, found.power_mean) == ("cannot tell", 0, 1.0, 0.0)
    assert found.visible_mm == np.inf


def test_what_was_calibrated_on_says_nothing_of_today():
    scan = first_day(4)
    rows = dataclasses.replace(table(scan), sha256="a")
    calibration = sc.calibrate(rows, image_size_px=image_size(scan))
    found = check_calibration(calibration, rows)
    assert found.verdict == "cannot tell"
    assert "made of" in found.diagnostics[0].message


def test_larger_knocks_are_seen_more_often(known):
    found = checked(known)
    powers = [found.power(knock(np.random.default_rng(1), mm)) for mm in (0.0, 0.3, 0.6, 1.2, 2.4, 500.0)]
    assert powers == sorted(powers)
    assert powers[0] == pytest.approx(0.005, abs=1e-4)
    assert powers[-1] == 1.0


def test_the_visible_change_is_seen_in_four_of_five(known):
    found = checked(known)
    there = dataclasses.replace(found, tolerance_mm=found.visible_mm)
    assert there.power_least == pytest.approx(0.8, abs=1e-6)


def test_what_means_nothing_is_refused(known):
    calibration, truth = known
    rows = table(later(3, truth))
    with pytest.raises(sc.InputError, match="positive number of mm"):
        check_calibration(calibration, rows, tolerance_mm=0.0)
    with pytest.raises(sc.UnsupportedError, match="predicts no error"):
        check_calibration(dataclasses.replace(calibration, covariance=None), rows)
    with pytest.raises(sc.InputError, match=r"shape \(4, 4\)"):
        check_calibration(calibration, rows).power(np.eye(3))


def test_lines_are_only_added_to_a_log(known, tmp_path):
    path = check_log_path(tmp_path / "calibration.json")
    assert path.name == "calibration.checks.jsonl"
    record = CheckRecord.of(checked(known), calibration="calibration.json")
    append_check(path, record)
    before = path.read_bytes()
    path.write_bytes(before + b'{"format":"sonocal-check","cut')  # a disk that was full
    append_check(path, record)
    append_check(path, record)
    assert path.read_bytes().startswith(before + b'{"format":"sonocal-check","cut\n')
    log = read_check_log(path)
    assert (len(log.checks), log.damaged) == (3, (2,))
    assert log.checks[0] == record
    page = checks_html(log).decode()
    assert "<svg" in page
    assert "no checks and were left as they are: 2" in page


def test_a_log_that_cannot_be_written_or_is_none_is_refused(known, tmp_path):
    record = CheckRecord.of(checked(known))
    with pytest.raises(sc.InputError, match="--no-log"):
        append_check(tmp_path / "nowhere" / "a.checks.jsonl", record)
    other = tmp_path / "other.jsonl"
    other.write_text('{"a": 1}\n')
    with pytest.raises(sc.FormatError, match="holds no check"):
        read_check_log(other)
