"""Wires that nobody names, on the command line: the report shows which dot was which."""

from pathlib import Path

import numpy as np
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main


def run(*arguments):
    return CliRunner(env={"COLUMNS": "200", "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


def test_the_report_of_a_scan_of_wires_shows_which_dot_was_which(tmp_path):
    made, out = tmp_path / "made", tmp_path / "out"
    scan = ("--target", "wires", "--look", "bath", "--frames", 20, "--seed", 1)
    assert run("simulate", *scan, "-o", made).exit_code == 0
    result = run("calibrate", made / "sweep.igs.mha", "--targets", made / "targets.toml", "-o", out)
    assert result.exit_code == 0, result.output
    page, rows = Path(out / "report.html").read_text(), sc.read_observations(out / "observations.csv")
    found = sc.load(out / "calibration.json")
    section = page[page.index("Which dot is which wire") : page.index("The matrix")]
    assert f"{np.count_nonzero(found.inlier)} of " in section
    for name in np.unique(rows.target):
        seen = len(np.unique(rows.frame[(rows.target == name) & found.inlier]))
        assert f'<td>{name}</td><td class="n">{seen}</td>' in section
    assert section.count('class="picture"') == 6
    # They show more than pictures of detections alone, which are left out.
    assert "<h2>Frames</h2>" not in page
