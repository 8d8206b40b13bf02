"""``sonocal tool --landmarks``: a phantom's place into a device set or a file of targets."""

import json

import numpy as np
import pytest
from benchmarks.simulators.landmark_session import EIGHT, TIP
from click.testing import CliRunner

from sonocal.cli.main import main
from sonocal.targets import read_device_set, read_targets
from tests.builders.phantoms import device_set, write_drags, write_touches


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A session, and phantoms of both kinds, in the folder that commands run in."""
    truth = write_touches(tmp_path)
    points = "\n".join(
        f'[[point]]\nname = "{i}"\nframe = "Phantom"\nat_mm = {x.tolist()}' for i, x in enumerate(EIGHT)
    )
    line = (
        '\n[[line]]\nname = "a"\nframe = "Phantom"\nfrom_mm = [30.0, 0.0, 20.0]\nto_mm = [30.0, 40.0, 20.0]\n'
    )
    (tmp_path / "phantom.toml").write_text(points + line)
    monkeypatch.chdir(tmp_path)
    return tmp_path, truth


def run(*arguments):
    return CliRunner(env={"COLUMNS": "100"}).invoke(main, ["tool", *arguments])


def test_the_place_is_put_into_the_device_set_and_nothing_else_changes(folder):
    path, truth = folder
    done = run("touches.igs.mha", "--landmarks", "phantom.xml", "-o", "registered.xml")
    assert done.exit_code == 0, done.output
    assert "PhantomToReference: 8 of 8 landmarks" in done.output
    before, after = (path / "phantom.xml").read_bytes(), (path / "registered.xml").read_bytes()
    at = after.index(b"    <!-- PhantomToReference")
    end = after.index(b"\r\n", after.index(b"<Transform", at)) + 2
    assert after[:at] + after[end:] == before
    written = read_device_set(path / "registered.xml").transforms["Reference", "Phantom"]
    np.testing.assert_allclose(
        EIGHT @ written[:3, :3].T + written[:3, 3], EIGHT @ truth[:3, :3].T + truth[:3, 3], atol=1
    )


def test_a_file_of_targets_gets_the_wires_in_the_reference(folder):
    path, truth = folder
    tip = ",".join(map(str, TIP))
    done = run("touches.igs.mha", "--landmarks", "phantom.toml", "--stylus-tip", tip, "-o", "placed.toml")
    assert done.exit_code == 0, done.output
    placed = read_targets(path / "placed.toml")
    assert ([x.frame for x in placed.lines], placed.points) == (["Reference"], ())
    expected = np.array([[30.0, 0, 20], [30, 40, 20]]) @ truth[:3, :3].T + truth[:3, 3]
    np.testing.assert_allclose(placed.lines[0].segment_mm, expected, atol=1)


def test_programs_get_the_numbers(folder):
    done = run("touches.igs.mha", "--landmarks", "phantom.xml", "--json")
    found = json.loads(done.output)
    assert len(found["landmarks"]) == 8
    assert found["target_errors"][0]["name"] == "a"


def test_lines_and_planes_that_were_dragged_along_put_a_phantom_in_place(folder):
    path, _ = folder
    truth = write_drags(path)
    options = ("--landmarks", "block.toml", "--stylus-tip", ",".join(map(str, TIP)), "-o", "placed.toml")
    done = run("drags.igs.mha", *options, "--dragged", "all")
    assert done.exit_code == 0, done.output
    shown = " ".join(done.output.split())
    assert "BlockToReference: 2 of 4 landmarks, 4 of 4 lines and planes" in shown
    placed = read_targets(path / "placed.toml")
    there = placed.lines[0].segment_mm
    expected = np.array([[0.0, 0, 50], [0, 60, 50]]) @ truth[:3, :3].T + truth[:3, 3]
    np.testing.assert_allclose(there, expected, atol=1)
    done = run(
        "drags.igs.mha",
        *options[:-2],
        "--dragged",
        "roof",
        "--dragged",
        "front",
        "--dragged",
        "left",
        "--json",
    )
    assert [one["name"] for one in json.loads(done.output)["features"]] == ["roof", "front", "left"]
    done = run("drags.igs.mha", *options[:-2], "--dragged", "floor")
    assert done.exit_code == 1
    assert "has no line or plane 'floor' to drag along; it has left edge, front" in " ".join(
        done.output.split()
    )


@pytest.mark.parametrize(
    ("arguments", "words", "status"),
    [
        (["--landmarks", "phantom.toml"], "phantom.toml: says nothing of the tip of Stylus; give it with", 1),
        (["--landmarks", "phantom.xml", "--stylus", "Pointer"], "has 0 transforms of a tip to Pointer", 1),
        (["--landmarks", "no-tip.xml"], "no-tip.xml: has 0 transforms of a tip to Stylus", 1),
        (["--landmarks", "two.xml"], "three landmarks or more, better six; got 2", 1),
        (
            ["--landmarks", "line.xml"],
            "lie on one line, about which it may turn; touch one beside it, too",
            1,
        ),
        (["--landmarks", "mirrored.xml"], "of the mirrored phantom", 1),
        (["--dragged", "roof"], "--dragged is for --landmarks, which is missing", 2),
        (["--landmarks", "touches.igs.mha"], "touches.igs.mha: is", 1),
        (["--landmarks", "bare.xml"], "bare.xml: its phantom has no landmarks; give each a", 1),
        (["--landmarks", "metres.xml"], "multiply its places by 1000", 1),
        (["--landmarks", "phantom.xml", "-o", "x.txt"], "is written as .xml or .toml", 1),
        (
            ["--landmarks", "phantom.toml", "--stylus-tip", "0,0,-9", "-o", "x.xml"],
            "needs a device set to stand in",
            1,
        ),
        (["--landmarks", "phantom.xml", "-o", "phantom.xml"], "is what this command reads", 1),
        (["--landmarks", "phantom.xml", "--spin", "touches.igs.mha"], "--spin is for tools", 2),
        (["--in-order"], "--in-order is for --landmarks, which is missing", 2),
    ],
)
def test_what_does_not_do_is_refused_in_a_sentence(folder, arguments, words, status):
    path, _ = folder
    (path / "bare.xml").write_text("<PlusConfiguration/>")
    (path / "metres.xml").write_text(device_set(EIGHT / 1000))
    (path / "mirrored.xml").write_text(device_set(EIGHT * [1, 1, -1]))
    (path / "two.xml").write_text(device_set(EIGHT[:2]))
    (path / "line.xml").write_text(device_set(np.outer(np.arange(5), [10.0, 5.0, 2.0])))
    without = device_set(EIGHT).replace('From="StylusTip" To="Stylus"', 'From="Image" To="Probe"')
    (path / "no-tip.xml").write_text(without)
    held = sorted(path.iterdir())
    done = run("touches.igs.mha", *arguments)
    assert done.exit_code == status, done.output
    assert words in " ".join(done.output.split())
    assert sorted(path.iterdir()) == held
