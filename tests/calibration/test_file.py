"""The file of a calibration: what it gives back, and files of earlier versions, kept here byte for byte."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

import sonocal as sc
from sonocal.calibration import calibration_json, parse_calibration
from sonocal.cli.main import main
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import give_verdict, validate
from tests.builders.calibrations import parted_rows, slipped_rows

# Of version 1, before calibrations knew what "auto" came to; with the table it was made from.
OLD = Path(__file__).parent / "files" / "version_1.json"
TABLE = OLD.with_suffix(".csv")


def run(*arguments):
    done = CliRunner(env={"COLUMNS": "80", "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])
    assert done.exit_code == 0, done.output
    return done.output


def old(**changes):
    """The old file with some of its fields changed; of its options, those named ``options``."""
    record = json.loads(OLD.read_text())
    record["provenance"]["options"] |= changes.pop("options", {})
    return parse_calibration(json.dumps(record | changes).encode(), "old.json")


def same(first, second):
    """Whether two calibrations are one, to the last bit."""
    if dataclasses.is_dataclass(first):
        return all(same(getattr(first, f.name), getattr(second, f.name)) for f in dataclasses.fields(first))
    if isinstance(first, np.ndarray):
        return first.dtype == second.dtype and np.array_equal(first, second, equal_nan=True)
    return first == second or (isinstance(first, float) and np.isnan(first) and np.isnan(second))


CALIBRATIONS = {
    "2D": lambda seed: sc.calibrate(simulate_observations(2, 30, outlier_share=0.2, seed=seed).observations),
    "3D": lambda seed: sc.calibrate(simulate_observations(3, 12, seed=seed).observations),
    "anisotropic": lambda seed: sc.calibrate(
        simulate_observations(2, 30, seed=seed).observations, model="anisotropic", image_size_px=(500, 500)
    ),
    "auto": lambda seed: sc.calibrate(
        simulate_observations(2, 30, outlier_share=0.2, seed=seed).observations, threshold_mm="auto"
    ),
    "geometric": lambda seed: sc.calibrate(
        simulate_observations(2, 20, seed=seed).observations, weighting="geometric"
    ),
    "held out": lambda seed: sc.calibrate(parted_rows(seed, moved_mm=4.0), test_split="test"),
    "minimal": lambda seed: sc.calibrate(simulate_observations(2, 4, seed=3).observations),
    "told": lambda seed: sc.calibrate(
        simulate_observations(2, 30, seed=seed).observations,
        scanner_mm_per_px=(0.3, 0.24),
        expected_rotation=np.eye(3),
    ),
}


@pytest.mark.parametrize("kind", CALIBRATIONS)
@settings(max_examples=6)
@given(seed=st.integers(0, 200))
def test_a_file_gives_back_the_calibration_to_the_last_bit(kind, seed):
    found = CALIBRATIONS[kind](seed)
    again = parse_calibration(calibration_json(found), "c.json")
    for field in dataclasses.fields(found):
        if field.name not in ("probe_from_image", "provenance"):
            assert same(getattr(again, field.name), getattr(found, field.name)), field.name
    read, written = again.probe_from_image.matrix, found.probe_from_image.matrix
    # Of anisotropic pixels the third scale, which no 2D image has, is not in the file.
    seen = [0, 1, 3] if kind == "anisotropic" else [0, 1, 2, 3]
    np.testing.assert_array_equal(read[:, seen], written[:, seen])
    np.testing.assert_allclose(read, written, rtol=1e-15, atol=0)
    assert {name: again.provenance[name] for name in found.provenance} == found.provenance
    assert give_verdict(again) == give_verdict(found)


@given(seed=st.integers(0, 200))
def test_a_file_written_again_is_the_same_file(seed):
    first = json.loads(calibration_json(CALIBRATIONS["told"](seed)))
    second = json.loads(calibration_json(parse_calibration(json.dumps(first).encode(), "c.json")))
    turns = [record.pop("rotation_wxyz") for record in (first, second)]
    np.testing.assert_allclose(*turns, rtol=0, atol=1e-15)
    assert first | {"created": ""} == second | {"created": ""}


def test_options_of_a_recording_stay_in_the_file():
    found = CALIBRATIONS["2D"](0)
    kept = found.provenance | {"options": found.provenance["options"] | {"probe": "L14", "count": 3}}
    again = parse_calibration(calibration_json(dataclasses.replace(found, provenance=kept)), "c.json")
    assert again.provenance["options"]["probe"] == "L14"
    assert again.options == found.options


def test_options_of_the_calibration_are_what_its_file_says():
    found = CALIBRATIONS["2D"](0)
    other = dataclasses.replace(found, options=dataclasses.replace(found.options, tolerance_mm=7.0))
    assert parse_calibration(calibration_json(other), "c.json").options.tolerance_mm == 7.0


# Earlier files


def test_a_file_of_version_1_is_read_and_its_auto_parts_the_rows_as_it_did():
    assert json.loads(OLD.read_text())["provenance"]["options"]["threshold_mm"] == "auto"
    found = sc.load(OLD)
    np.testing.assert_array_equal(found.residuals_mm <= found.threshold_mm, found.inlier)
    assert 0 < found.inlier.sum() < len(found.inlier)
    assert found.options.seed == 0


def test_a_file_of_version_1_is_what_the_same_rows_give_today():
    """But for what later versions do better: a small part of what the file says that it may be off by."""
    found, today = sc.load(OLD), sc.calibrate(sc.read_observations(TABLE), threshold_mm="auto")
    places, rms, _ = found.predicted_errors()
    moved = np.linalg.norm(today.probe_from_image @ places - found.probe_from_image @ places, axis=1)
    assert np.all(moved < 0.2 * rms)
    np.testing.assert_allclose(today.predicted_errors()[1], rms, rtol=0.05)
    assert today.provenance["sha256"] == found.provenance["sha256"]


def test_where_all_rows_agree_auto_is_beyond_all_of_them():
    record = json.loads(OLD.read_text())
    found = old(inlier=[True] * len(record["inlier"]))
    assert np.all(found.residuals_mm <= found.threshold_mm)


def test_an_old_file_without_options_has_the_defaults():
    record = json.loads(OLD.read_text())
    del record["provenance"]["options"]
    found = parse_calibration(json.dumps(record).encode(), "c.json")
    assert found.options == sc.calibration.Options()
    assert give_verdict(found).level in ("use", "care", "stop")


def test_an_option_in_a_file_that_is_none_is_a_damaged_file():
    with pytest.raises(sc.FormatError, match=r"old\.json: is a damaged calibration file .*tolerance_mm"):
        old(options={"tolerance_mm": -3})
    with pytest.raises(sc.FormatError, match="residuals_mm has 20 entries and inlier 1"):
        old(inlier=[True])


def test_every_command_takes_a_file_of_version_1_with_auto(tmp_path):
    calibration, table = tmp_path / "version_1.json", tmp_path / "version_1.csv"
    calibration.write_bytes(OLD.read_bytes())
    table.write_bytes(TABLE.read_bytes())
    assert "Leave one frame out" in run("validate", calibration, table)
    assert "Residuals by frame" in (tmp_path / "validation.html").read_text()
    assert "probe_from_image" in run("info", calibration)
    for form, name in (("plus", "a.xml"), ("itk", "a.tfm"), ("slicer", "b.tfm"), ("json", "again.json")):
        assert f"Wrote {tmp_path / name}" in run("export", calibration, "--to", form, "-o", tmp_path / name)
    assert sc.load(tmp_path / "again.json").options == sc.load(calibration).options


def test_auto_works_to_the_end_of_every_command(tmp_path):
    sc.write_observations(slipped_rows(), tmp_path / "a.csv")
    out = tmp_path / "out"
    run("calibrate", tmp_path / "a.csv", "-o", out, "--threshold-mm", "auto")
    assert "Residuals by frame" in (out / "report.html").read_text()
    assert "Leave one frame out" in run("validate", out / "calibration.json", tmp_path / "a.csv")
    run("export", out / "calibration.json", "--to", "plus", "-o", out / "a.xml", "--force")
    rows, found = sc.read_observations(tmp_path / "a.csv"), sc.load(out / "calibration.json")
    assert validate(found, rows, resample=False).diagnostics == ()


@pytest.mark.parametrize(
    "kept", [{"options": "x"}, {"recorded": {"recording": 3}}, {"versions": []}, {"input": 3}]
)
def test_a_provenance_of_another_shape_is_a_damaged_file(kept):
    record = json.loads(OLD.read_text())
    record["provenance"] |= kept
    with pytest.raises(sc.FormatError, match=rf"is a damaged calibration file .*{next(iter(kept))}"):
        parse_calibration(json.dumps(record).encode(), "c.json")


@pytest.mark.parametrize("part", ["fit", "test"])
@pytest.mark.parametrize(
    ("name", "value"), [("inliers", -1), ("inliers", 10**6), ("rms_mm", -1.0), ("max_mm", 1e200)]
)
def test_errors_that_no_rows_have_are_a_damaged_file(part, name, value):
    record = json.loads(OLD.read_text())
    record[part] = record["fit"] | {name: value}
    with pytest.raises(sc.FormatError, match=rf"is a damaged calibration file \({part} has "):
        parse_calibration(json.dumps(record).encode(), "c.json")


def test_a_place_that_no_room_has_is_a_damaged_file():
    record = json.loads(OLD.read_text())
    record["probe_from_image"][0][3] = 1e200
    with pytest.raises(sc.FormatError, match="probe_from_image holds a number that is not below 1e\\+09"):
        parse_calibration(json.dumps(record).encode(), "c.json")
