"""However narrow the terminal: no number is cut, and every number of a wide one is there."""

import io
import re
import shutil
from collections import Counter

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

import sonocal as sc
from sonocal.cli.main import main
from sonocal.cli.screen.tables import MatrixRows, NumberTable
from sonocal.export.plus import plus_xml
from sonocal.recording import Poses, Recording
from sonocal.recording.formats import write_recording
from sonocal.report import report_html
from sonocal.simulation.scene import simulate_observations
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.truth_file import truth_json
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear
from tests.builders.recordings import random_recording
from tests.builders.sound import TFM
from tests.builders.targets import LINE, PHANTOM, POINT
from tests.builders.tracked_tools import pivoting, spinning

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
COMMANDS = {
    "calibration": ("info", "calibration.json"),
    "sightings": ("info", "table.csv"),
    "recording": ("info", "images.igs.mha"),
    "long names": ("info", "long.igs.mha"),
    "targets": ("info", "targets.toml"),
    "devices": ("info", "devices.xml"),
    "points": ("info", "points.csv"),
    "demo": ("demo", "--no-report", "-o", "demo", "--overwrite"),
    "validate": ("validate", "calibration.json", "table.csv", "--no-report"),
    "compare": ("validate", "calibration.json", "table.csv", "--no-report", "--compare", "other.json"),
    "matrix": ("info", "ImageToProbe.tfm"),
    "plus": ("info", "plus.xml"),
    "existing": ("validate", "plus.xml", "table.csv", "--compare", "ImageToProbe.tfm"),
    "difference": ("validate", "calibration.json", "table.csv", "--no-report", "--compare", "plus.xml"),
    "truth": ("info", "truth.json"),
    "page": ("info", "report.html"),
    "results": ("info", "results"),
    "tool": ("tool", "pivot.igs.mha", "--spin", "spin.igs.mha", "--tool", "Needle"),
    "studies": ("study",),
    "study": ("study", "needles", "--trials", "3", "--no-figure", "-o", "study"),
}


def run(*arguments, width):
    return CliRunner(env={"COLUMNS": str(width), "TERM": "dumb"}).invoke(main, arguments)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with what the commands read."""
    folder = tmp_path_factory.mktemp("widths")
    rows = simulate_observations(2, 30, seed=5).observations
    sc.write_observations(rows, folder / "table.csv")
    sc.calibrate(rows).save(folder / "calibration.json")
    sc.calibrate(simulate_observations(2, 12, seed=6).observations).save(folder / "other.json")
    write_recording(random_recording(0, n=100), folder / "images.igs.mha")
    write_recording(random_recording(0, tools=("Probe" * 9, "Needle")), folder / "long.igs.mha")
    rng = np.random.default_rng(0)
    for name, matrices in {"pivot": pivoting(rng), "spin": spinning(rng)}.items():
        needle = Poses.of("Needle", "Tracker", matrices)
        recording = Recording(times=np.arange(len(matrices)) / 20, poses={needle.name: needle})
        write_recording(recording, folder / f"{name}.igs.mha")
    (folder / "plus.xml").write_bytes(plus_xml(sc.load(folder / "other.json")))
    (folder / "ImageToProbe.tfm").write_bytes(TFM)
    (folder / "targets.toml").write_text(LINE + POINT)
    (folder / "devices.xml").write_text(PHANTOM)
    sweep = simulate_sweep(curvilinear(64, 64, 1.5), BATH, SweepOptions(frames=5, seed=2))
    (folder / "truth.json").write_bytes(truth_json(sweep))
    (folder / "report.html").write_bytes(report_html(sc.load(folder / "calibration.json")))
    run("study", "needles", "--trials", "3", "--no-figure", "-o", str(folder / "results"), width=80)
    (folder / "points.csv").write_text("frame,u_px,v_px\n0,1,2\n")
    return folder


def numbers(text):
    return Counter(NUMBER.findall(text))


@pytest.mark.parametrize("command", COMMANDS)
def test_every_number_of_a_wide_terminal_is_on_a_narrow_one(files, monkeypatch, command):
    monkeypatch.chdir(files)
    wide = run(*COMMANDS[command], width=200)
    assert wide.exit_code == 0, wide.output
    assert numbers(wide.output).total() > 1
    for width in (40, 60, 80, 100):
        narrow = run(*COMMANDS[command], width=width)
        assert numbers(wide.output) <= numbers(narrow.output), width  # headings come once a row
        assert "…" not in narrow.output


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_lines_fit_a_narrow_terminal_but_those_to_copy(files, monkeypatch, command):
    monkeypatch.chdir(files)
    for line in run(*COMMANDS[command], width=40).stdout.splitlines():
        assert len(line) <= 40 or line.startswith(("Wrote ", "Next: ")), line


def test_paths_and_errors_are_one_line_each_however_narrow(files, tmp_path):
    deep = tmp_path / ("a folder with a long name" * 3) / "results of today"
    done = run("calibrate", str(files / "table.csv"), "-o", str(deep), "--no-report", width=40)
    assert f"Wrote {deep / 'calibration.json'}\n" in done.stdout
    shutil.rmtree(deep)
    refused = run("calibrate", str(deep / "no table.csv"), width=40)
    assert refused.stderr.startswith(f"Error: {deep / 'no table.csv'}: there is no such file")
    assert refused.stderr.count("\n") == 1


def test_colours_are_for_terminals_that_want_them(files, monkeypatch):
    monkeypatch.chdir(files)
    plain = run("info", "calibration.json", width=80).stdout
    environment = {"COLUMNS": "80", "TERM": "xterm-256color", "FORCE_COLOR": "1"}
    coloured = CliRunner(env=environment).invoke(main, ["info", "calibration.json"], color=True).stdout
    bare = (
        CliRunner(env=environment | {"NO_COLOR": "1"})
        .invoke(main, ["info", "calibration.json"], color=True)
        .stdout
    )
    colour, style = re.compile(r"\x1b\[[\d;]*3\d[\d;]*m"), re.compile(r"\x1b\[[\d;]*m")
    assert "\x1b" not in plain
    assert colour.search(coloured)
    assert not colour.search(bare)
    assert style.sub("", coloured) == style.sub("", bare) == plain


def shown(what, width):
    out = io.StringIO()
    Console(file=out, width=width, highlight=False).print(what)
    return out.getvalue()


CELLS = st.one_of(
    st.floats(-1e6, 1e6).map("{:.4f}".format),
    st.tuples(st.integers(0, 10**6), st.integers(0, 10**6)).map("{0[0]} of {0[1]}".format),
    st.just(""),
)
WORDS = st.text("abc [/]ß漢 ", max_size=60)


@given(st.data(), st.integers(12, 120))
def test_a_table_of_anything_keeps_its_numbers_and_its_width(data, width):
    columns = data.draw(st.integers(1, 6))
    table = NumberTable(data.draw(WORDS), *(data.draw(WORDS) for _ in range(columns)), first="name")
    cells = [data.draw(st.lists(CELLS, min_size=columns, max_size=columns)) for _ in range(3)]
    for row in cells:
        table.add_row(data.draw(WORDS), *row)
    text = shown(table, width)
    assert numbers(text) == numbers(" ".join(cell for row in cells for cell in row))
    assert "…" not in text


@given(
    st.lists(st.lists(st.floats(-1e4, 1e4), min_size=4, max_size=4), min_size=1, max_size=4),
    st.integers(20, 120),
)
def test_a_matrix_keeps_its_numbers_in_their_order_at_any_width(matrix, width):
    lines = shown(MatrixRows(np.array(matrix)), width)
    assert [float(number) for number in lines.split()] == [round(x, 6) for row in matrix for x in row]
    assert max(map(len, lines.splitlines())) <= width
