"""The sample recording: small, the same everywhere, and right."""

import numpy as np
import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.simulation.sample import sample_sweep
from sonocal.targets import read_lines
from sonocal.validation import give_verdict


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sample")
    done = CliRunner().invoke(main, ["sample", "-o", str(folder)], catch_exceptions=False)
    assert done.exit_code == 0
    return folder


def test_it_holds_a_recording_its_needle_and_the_truth_in_less_than_two_megabytes(folder):
    assert {path.name for path in folder.iterdir()} == {"sweep.igs.mha", "needle.toml", "truth.json"}
    assert sum(path.stat().st_size for path in folder.iterdir()) < 2e6


def test_it_is_the_same_sweep_wherever_it_is_made(folder):
    written, made = sc.read_recording(folder / "sweep.igs.mha"), sample_sweep().recording
    for frame in (0, 77, 149):
        assert np.array_equal(written.frames[frame], made.frames[frame])
    assert np.array_equal(
        written.poses["tracker_from_probe"].matrices, made.poses["tracker_from_probe"].matrices
    )


def test_it_is_calibrated_with_nobody_clicking_and_the_answer_is_within_what_is_predicted(folder):
    lines, fixed = read_lines(folder / "needle.toml")
    found = sc.calibrate_recording(
        sc.read_recording(folder / "sweep.igs.mha"), lines, fixed=fixed
    ).calibration
    corners, _, bound = found.predicted_errors()
    error = np.linalg.norm(
        found.probe_from_image @ corners - sample_sweep().truth.probe_from_image @ corners, axis=1
    )
    assert give_verdict(found).headline == "Use it"
    assert np.all(error < bound)
