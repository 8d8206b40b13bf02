"""Another calibration beside the page's: the page says what ``sonocal validate --compare`` says."""

import json
import re

import click
import numpy as np
import pytest

from sonocal.calibration import load_calibration
from sonocal.cli import main
from sonocal.existing import read_existing
from sonocal.existing.compared import compared
from sonocal.validation import compare
from tests.builders.studio import heard, running

FORMS = {"plus.xml": "plus", "slicer.tfm": "slicer", "itk.h5": "itk"}


@pytest.fixture(scope="module")
def calibration(sweep, tmp_path_factory):
    """The sweep's own, as the command line finds it."""
    folder = tmp_path_factory.mktemp("own")
    source, lines = map(str, sweep)
    main.main(
        ["calibrate", source, "--lines", lines, "-o", str(folder / "own"), "--no-report"],
        standalone_mode=False,
    )
    return folder / "own" / "calibration.json"


@pytest.fixture
def others(calibration, tmp_path):
    """One matrix, 2 mm from it, in every form; and the calibration itself."""
    own = load_calibration(calibration)
    matrix = own.probe_from_image.matrix.copy()
    matrix[0, 3] += 2.0
    np.savetxt(tmp_path / "matrix.txt", matrix)
    np.save(tmp_path / "matrix.npy", matrix)
    for name, program in FORMS.items():
        to = ["--to", program, "-o", str(tmp_path / name), "--force"]
        main.main(["export", str(tmp_path / "matrix.txt"), *to], standalone_mode=False)
    return [tmp_path / name for name in ("matrix.txt", "matrix.npy", *FORMS)]


def sent(one, path):
    assert one.ask("/inputs", "PUT", path.read_bytes(), X_Name=path.name)[0] == 200
    status, _, content = one.ask("/compare", "POST", json.dumps({"other": path.name}))
    return status, json.loads(content)


def test_every_form_of_a_matrix_is_compared_and_follows_the_points(sweep, others, calibration, tmp_path):
    own = load_calibration(calibration)
    with (
        running(tmp_path / "studio", sweep[0], "--lines", sweep[1], "--compare", others[0]) as one,
        one.cookie().events() as socket,
    ):
        frame = heard(socket, "answer")["residuals"][0][0]
        first = heard(socket, "beside", name="matrix.txt")["sentences"]
        for path in others[1:]:
            assert sent(one, path) == (200, {})
            told = heard(socket, "beside", name=path.name)["sentences"]
            other = read_existing(path)
            assert told == [f"Ours and {other.said}: {compared(other, own).difference.sentence}"]
            assert told[0].partition(": ")[2] == first[0].partition(": ")[2]
        assert "2.00 mm apart" in first[0]
        assert sent(one, calibration) == (200, {})
        same = heard(socket, "beside", name="calibration.json")["sentences"]
        assert same[0].partition(" mm")[0] == compare(own, own).sentence.partition(" mm")[0]
        assert sent(one, others[1]) == (200, {})
        socket.send(json.dumps({"id": "1", "action": "drop", "frame": frame, "target": "needle"}))
        matrix = np.array(heard(socket, "answer", touched=True)["matrix"])
        (said,) = heard(socket, "beside")["sentences"]
    most, u, v, there = re.search(
        r"up to (.+) mm apart[,;] at \((.+?), (.+?)\) px(?: (.+?) mm)?", said
    ).groups()
    off = (np.load(others[1]) - matrix) @ [float(u), float(v), 0, 1]
    assert float(there or most) == pytest.approx(np.linalg.norm(off), abs=0.006)


def test_what_was_misread_is_said_to_be(sweep, calibration, tmp_path):
    matrix = load_calibration(calibration).probe_from_image.matrix
    np.save(tmp_path / "metres.npy", np.diag([1e-3, 1e-3, 1e-3, 1]) @ matrix)
    with (
        running(tmp_path / "studio", sweep[0], "--lines", sweep[1]) as one,
        one.cookie().events() as socket,
    ):
        heard(socket, "answer")
        assert sent(one, tmp_path / "metres.npy") == (200, {})
        told = heard(socket, "beside")["sentences"]
    assert any("metres" in sentence for sentence in told[1:])


def test_what_is_no_calibration_is_refused_in_a_sentence(studio, sweep, tmp_path):
    status, told = sent(studio, sweep[1])
    assert (status, "is a file of needles" in told["refused"]) == (400, True)
    assert json.loads(studio.ask("/compare", "POST", json.dumps({"other": "none.xml"}))[2]) == {
        "refused": "'none.xml': no such file was sent"
    }
    command = [
        "studio",
        str(sweep[0]),
        "--lines",
        str(sweep[1]),
        "--no-browser",
        "-o",
        str(tmp_path / "studio"),
    ]
    with pytest.raises(click.ClickException, match="is a file of needles"):
        main.main([*command, "--compare", str(sweep[1])], standalone_mode=False)
    with pytest.raises(click.UsageError, match="--stored-as is for --compare, which is missing"):
        main.main([*command, "--stored-as", "inverse"], standalone_mode=False)
