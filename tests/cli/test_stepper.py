"""``sonocal tool --stepper``: two axes, said and as numbers; what means nothing beside it is refused."""

import json

import numpy as np
import pytest
from benchmarks.simulators.stepper import stepper
from benchmarks.steppers import angle_deg
from click.testing import CliRunner

from sonocal.cli.main import main
from tests.builders.pages import write_poses


@pytest.fixture
def truth(tmp_path, monkeypatch):
    turned, moved, truth = stepper(1)
    write_poses(tmp_path / "turned.igs.mha", Probe=turned)
    write_poses(tmp_path / "moved.igs.mha", Probe=moved)
    monkeypatch.chdir(tmp_path)
    return truth


def run(*arguments):
    return CliRunner(env={"COLUMNS": "100"}).invoke(main, ["tool", *arguments])


def test_the_axes_are_shown_and_given_to_programs(truth):
    done = run("turned.igs.mha", "--stepper", "moved.igs.mha", "--tool", "Probe")
    assert done.exit_code == 0, done.output
    assert "a turn about the axis along" in " ".join(done.output.split())
    done = run("turned.igs.mha", "--stepper", "moved.igs.mha", "--tool", "Probe", "--json")
    assert angle_deg(np.array(json.loads(done.output)["axis"]), truth[0]) < 0.1


@pytest.mark.parametrize(
    ("arguments", "words", "status"),
    [
        (
            ["--stepper", "moved.igs.mha", "--tool", "Probe", "-o", "a.toml"],
            "-o means nothing with --stepper",
            2,
        ),
        (["--stepper", "turned.igs.mha", "--tool", "Probe"], "went on no line", 1),
        (["--stepper", "moved.igs.mha", "--tool", "Other"], "Other", 1),
    ],
)
def test_what_does_not_do_is_refused_in_a_sentence(truth, arguments, words, status):
    done = run("turned.igs.mha", *arguments)
    assert done.exit_code == status, done.output
    assert words in " ".join(done.output.split())
