"""What a user says of the set-up: the calibration to expect, from our file or a device set; units that are doubted."""

import dataclasses
import json
import tomllib

import numpy as np
import pytest
from benchmarks.simulators.scans import scan
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.export.plus import plus_xml
from sonocal.simulation.scene import simulate_observations

UNITS = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4}
SIDE = 500


def run(*arguments):
    return CliRunner(env={"COLUMNS": "200", "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


def codes_of(result):
    assert result.exit_code == 0, result.output
    return {one["code"] for one in json.loads(result.stdout)["diagnostics"]}


@pytest.fixture
def seen():
    return simulate_observations(2, 40, seed=3).observations


@pytest.fixture(params=["calibration.json", "devices.xml"])
def expected(request, seen, tmp_path):
    """An earlier calibration of the probe as a file of ours and as a device set."""
    found = sc.calibrate(seen)
    path = tmp_path / request.param
    if path.suffix == ".xml":
        path.write_bytes(plus_xml(found))
    else:
        found.save(path)
    return path


def written(rows, tmp_path):
    sc.write_observations(rows, tmp_path / "scan.csv")
    return tmp_path / "scan.csv"


def mirrored(rows, axes):
    changed = rows.points_px.copy()
    changed[:, axes] = SIDE - 1 - changed[:, axes]
    return dataclasses.replace(rows, points_px=changed)


@pytest.mark.parametrize(
    ("axes", "how"),
    [([0], "left and right are exchanged"), ([1], "top and bottom are"), ([0, 1], "turned by half a turn")],
)
def test_an_image_that_is_flipped_against_the_one_expected_is_named(axes, how, seen, expected, tmp_path):
    table = written(mirrored(seen, axes), tmp_path)
    result = run("calibrate", table, "--expected", expected, "-o", tmp_path / "out", "--no-report")
    assert result.exit_code == 0, result.output
    assert "Do not use it" in result.output
    assert how in result.output
    unknown = run("calibrate", table, "-o", tmp_path / "other", "--no-report", "--json")
    assert "flipped-image" not in codes_of(unknown)


def test_the_image_expected_is_not_accused(seen, expected, tmp_path):
    table = written(seen, tmp_path)
    told = run("calibrate", table, "--expected", expected, "-o", tmp_path / "out", "--no-report", "--json")
    assert "flipped-image" not in codes_of(told)


def test_what_is_expected_counts_in_validation_too(seen, expected, tmp_path):
    table = written(mirrored(seen, [0]), tmp_path)
    done = run("calibrate", table, "-o", tmp_path / "out", "--no-report")
    assert done.exit_code == 0, done.output
    said = run(
        "validate", tmp_path / "out" / "calibration.json", table, "--expected", expected, "--no-report"
    )
    assert said.exit_code == 0, said.output
    assert "left and right are exchanged" in said.output


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            "<PlusConfiguration><CoordinateDefinitions/></PlusConfiguration>",
            "has no Transform in its CoordinateDefinitions",
        ),
        (
            "<PlusConfiguration><CoordinateDefinitions>"
            + "".join(
                f'<Transform From="Image" To="{to}" Matrix="{MATRIX}"/>' for to in ("Probe", "Reference")
            )
            + "</CoordinateDefinitions></PlusConfiguration>"
            if (MATRIX := "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1")
            else "",
            "that may be the calibration: ImageToProbe, ImageToReference; name one with --transform",
        ),
        (
            '<PlusConfiguration><CoordinateDefinitions><Transform From="Image" To="Probe" '
            'Matrix="1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 1"/></CoordinateDefinitions></PlusConfiguration>',
            "cannot be inverted",
        ),
    ],
)
def test_a_device_set_without_one_image_is_refused_in_a_sentence(content, words, seen, tmp_path):
    (tmp_path / "devices.xml").write_text(content)
    result = run(
        "calibrate", written(seen, tmp_path), "--expected", tmp_path / "devices.xml", "-o", tmp_path / "out"
    )
    assert result.exit_code == 1
    assert words in result.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("unit", UNITS)
def test_info_doubts_a_tables_units_by_the_name_that_calibrate_does(unit, dimension, tmp_path):
    rows = scan(4, dimension=dimension, outliers=0).observations
    table = written(dataclasses.replace(rows, segments_mm=rows.segments_mm / UNITS[unit]), tmp_path)
    refused = run("calibrate", table, "-o", tmp_path / "out")
    shown = run("info", table)
    assert (refused.exit_code, shown.exit_code) == (1, 0)
    for result in (refused, shown):
        assert unit in result.output.partition("?")[0]
    (split,) = json.loads(run("info", table, "--json").stdout)
    assert [one["code"] for one in split["diagnostics"]] == ["implausible-units"]


@pytest.mark.parametrize("dimension", [2, 3])
def test_info_doubts_no_sound_table(dimension, tmp_path):
    for seed in range(5):
        table = written(scan(seed, dimension=dimension, outliers=0).observations, tmp_path)
        assert "re these" not in run("info", table).output


def test_info_of_rows_without_a_calibration_shows_them(seen, tmp_path):
    one = dataclasses.replace(seen, segments_mm=np.repeat(seen.segments_mm[:1], len(seen), axis=0))
    shown = run("info", written(one, tmp_path))
    assert (shown.exit_code, "sightings for a 2D probe" in shown.output) == (0, True)


@pytest.mark.parametrize(("length", "unit"), [(0.25, "metres"), (250.0, None), (30.0, None), (4000.0, "")])
def test_info_doubts_a_needles_length_as_calibrate_does(length, unit, tmp_path):
    text = f'[[line]]\nname = "needle"\nframe = "Needle"\nfrom_mm = [0.0, 0.0, 0.0]\nto_mm = [0.0, 0.0, -{length}]\n'
    assert tomllib.loads(text)
    (tmp_path / "needle.toml").write_text(text)
    shown = run("info", tmp_path / "needle.toml")
    assert shown.exit_code == 0
    assert ("re these" in shown.output) == (unit is not None)
    assert (unit or "") in shown.output
    record = json.loads(run("info", tmp_path / "needle.toml", "--json").stdout)
    assert [one["code"] for one in record["diagnostics"]] == ["implausible-units"] * (unit is not None)
    assert len(record["lines"]) == 1


def test_info_doubts_the_wires_of_a_device_set(tmp_path):
    wires = "".join(
        f'<Wire Name="{i}" EndPointFront="0 0.0{i} 0" EndPointBack="0 0.0{i} 0.04"/>' for i in range(3)
    )
    (tmp_path / "devices.xml").write_text(
        "<PlusConfiguration><CoordinateDefinitions/><PhantomDefinition><Geometry>"
        f'<Pattern Type="NWire">{wires}</Pattern></Geometry></PhantomDefinition></PlusConfiguration>'
    )
    assert "re these metres?" in run("info", tmp_path / "devices.xml").output
