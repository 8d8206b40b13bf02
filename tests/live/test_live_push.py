"""``sonocal live --push``: the calibration at the end is in the server."""

import numpy as np
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli import main
from sonocal.simulation.sweep import NEEDLE
from sonocal.targets.toml_file import write_lines
from tests.builders.live import served, swept
from tests.builders.plus_server import FakePlus


def test_what_is_calibrated_live_is_pushed(tmp_path):
    write_lines([NEEDLE], tmp_path / "needle.toml")
    with served(swept(60)) as port, FakePlus() as plus:
        words = [
            "live",
            "--connect",
            f"127.0.0.1:{port}",
            "--lines",
            str(tmp_path / "needle.toml"),
            "--no-report",
        ]
        result = CliRunner().invoke(
            main, [*words, "--images", "60", "-o", str(tmp_path / "out"), "--push", plus.address, "--yes"]
        )
    assert result.exit_code == 0, result.output
    found = sc.load(tmp_path / "out" / "calibration.json")
    np.testing.assert_array_equal(plus.matrix("ImageToProbe"), found.probe_from_image.matrix)
    assert plus.saved == ["its own"]
