"""Targets whose place nobody knows, on the command line: what is read, printed, written and refused."""

import json

import numpy as np
import pytest
from benchmarks.simulators.places import Noise, image_points, sweep
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from tests.builders.tank import unplaced_table

THREAD = '[[line]]\nname = "thread"\nframe = "Tracker"\nplace = "unknown"\n'


def run(*arguments):
    return CliRunner(env={"COLUMNS": "200", "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def tank(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tank")
    scene = sweep("line", 60, 5, Noise())
    sc.write_observations(unplaced_table(scene, image_size_px=(501, 501)), folder / "tank.csv")
    (folder / "thread.toml").write_text(THREAD)
    return folder, scene


def test_a_table_of_poses_is_calibrated_and_its_thread_told(tank, tmp_path):
    folder, scene = tank
    out = tmp_path / "out"
    result = run("calibrate", folder / "tank.csv", "--targets", folder / "thread.toml", "-o", out)
    assert result.exit_code == 0, result.output
    said = " ".join(result.stdout.split())
    assert "Line 'thread' is at (" in said
    assert "mm in the frame Tracker" in said
    found = sc.load(out / "calibration.json")
    there = image_points() @ scene.truth[:3, :3].T + scene.truth[:3, 3]
    assert np.linalg.norm(found.probe_from_image @ image_points() - there, axis=1).max() < 1.5
    target = found.targets["thread"]
    away = scene.place - target.middle_mm
    assert np.linalg.norm(np.cross(away, target.direction), axis=1).max() < 2
    page = (out / "report.html").read_text()
    assert "thread" in page
    assert "in the frame Tracker" in page
    # What it wrote is a table like any other: with its lines in it.
    rows = sc.read_observations(out / "observations.csv")
    assert rows.lines_only
    assert found.provenance["input"] == "observations.csv"
    assert found.provenance["recorded"]["table"]["input"] == "tank.csv"
    for command in (
        ("validate", out / "calibration.json", out / "observations.csv"),
        ("info", out / "calibration.json"),
    ):
        done = run(*command)
        assert done.exit_code == 0, done.output


def test_the_same_in_json(tank, tmp_path):
    folder, _ = tank
    arguments = ("--targets", folder / "thread.toml", "-o", tmp_path / "out", "--no-report", "--json")
    result = run("calibrate", folder / "tank.csv", *arguments)
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["targets"]["thread"]["kind"] == "line"
    assert len(told["targets"]["thread"]["covariance"]) == 4


def test_what_is_missing_is_refused_in_a_sentence_and_nothing_is_written(tank, tmp_path):
    folder, _ = tank
    still = tmp_path / "still.csv"
    sc.write_observations(unplaced_table(sweep("line", 60, 5, Noise(), motion="translation")), still)
    placed = tmp_path / "placed.csv"
    random = np.random.default_rng(0)
    sc.write_observations(sc.Observations(random.random((9, 2)), random.random((9, 2, 3))), placed)
    known = tmp_path / "known.toml"
    known.write_text(THREAD.replace("thread", "wire"))
    for source, targets, said in [
        (folder / "tank.csv", None, "target 'thread' is given by its pose alone; say in a file of targets"),
        (folder / "tank.csv", known, "target 'thread' is none of the targets wire"),
        (
            still,
            folder / "thread.toml",
            "still.csv: the target's place is not known, and the probe hardly turned",
        ),
        (
            placed,
            folder / "thread.toml",
            "placed.csv: is a table of sightings, which has its lines in it; leave out",
        ),
        (folder / "tank.csv", folder / "tank.csv", "tank.csv"),
    ]:
        more = () if targets is None else ("--targets", targets)
        result = run("calibrate", source, *more, "-o", tmp_path / "none")
        assert result.exit_code == 1, result.output
        assert said in " ".join(result.stderr.split())
        assert not (tmp_path / "none").exists()


def test_info_shows_the_targets_and_the_table(tank):
    folder, _ = tank
    targets, table = run("info", folder / "thread.toml"), run("info", folder / "tank.csv")
    assert targets.exit_code == 0, targets.output
    assert table.exit_code == 0, table.output
    assert "unknown" in targets.stdout
    assert "thread" in targets.stdout


def test_other_commands_say_that_the_place_is_missing(tank, tmp_path):
    folder, _ = tank
    out = tmp_path / "out"
    assert (
        run("calibrate", folder / "tank.csv", "--targets", folder / "thread.toml", "-o", out).exit_code == 0
    )
    result = run("validate", out / "calibration.json", folder / "tank.csv")
    assert result.exit_code == 1
    assert "says nothing of where its target 'thread' is" in " ".join(result.stderr.split())


def test_a_needle_that_was_never_pivoted_is_found_in_images(tmp_path):
    sweep_of = simulate_sweep(options=SweepOptions(frames=120, sigma_mm=0.3, hidden_share=0.1, seed=2))
    write_sweep(sweep_of, tmp_path / "sweep")
    needle = tmp_path / "needle.toml"
    needle.write_text(THREAD.replace("thread", "needle").replace("Tracker", "Needle"))
    (recording,) = (tmp_path / "sweep").glob("*.mha")
    out = tmp_path / "out"
    result = run("calibrate", recording, "--targets", needle, "-o", out)
    assert result.exit_code == 0, result.output
    assert "Line 'needle' is at (" in " ".join(result.stdout.split())
    found = sc.load(out / "calibration.json")
    truth = sweep_of.truth.probe_from_image
    corners = np.array([[0.0, 0], [499, 0], [0, 499], [499, 499]])
    assert np.linalg.norm(found.probe_from_image @ corners - truth @ corners, axis=1).max() < 2
    target = found.targets["needle"]
    assert abs(target.direction[2]) > 0.999  # along its marker's z, through its origin
    assert np.linalg.norm(np.cross(target.middle_mm, target.direction)) < 2
    assert sorted(path.name for path in out.iterdir()) == [
        "calibration.json",
        "contact-sheet.png",
        "observations.csv",
        "report.html",
    ]


def test_points_of_a_recording_are_taken_against_a_thread_nobody_placed(tmp_path):
    sweep_of = simulate_sweep(options=SweepOptions(frames=80, sigma_mm=0.3, seed=4, hidden_share=0.0))
    write_sweep(sweep_of, tmp_path / "sweep")
    (recording,) = (tmp_path / "sweep").glob("*.mha")
    needle = tmp_path / "needle.toml"
    needle.write_text(THREAD.replace("thread", "needle").replace("Tracker", "Needle"))
    shown = sweep_of.truth.visible
    lines = [f"{i},{u!r},{v!r}" for i, (u, v) in enumerate(sweep_of.truth.shown_px.tolist()) if shown[i]]
    (tmp_path / "points.csv").write_text("frame,u_px,v_px\n" + "\n".join(lines) + "\n")
    out = tmp_path / "out"
    result = run("calibrate", recording, "--targets", needle, "--points", tmp_path / "points.csv", "-o", out)
    assert result.exit_code == 0, result.output
    found = sc.load(out / "calibration.json")
    corners = np.array([[0.0, 0], [499, 0], [0, 499], [499, 499]])
    truth = sweep_of.truth.probe_from_image
    assert np.linalg.norm(found.probe_from_image @ corners - truth @ corners, axis=1).max() < 3


def test_a_floor_that_images_do_not_show_is_refused(tmp_path):
    sweep_of = simulate_sweep(options=SweepOptions(frames=10, seed=3))
    write_sweep(sweep_of, tmp_path / "sweep")
    (recording,) = (tmp_path / "sweep").glob("*.mha")
    (tmp_path / "floor.toml").write_text('[[plane]]\nname = "floor"\nframe = "Tracker"\nplace = "unknown"\n')
    result = run("calibrate", recording, "--targets", tmp_path / "floor.toml", "-o", tmp_path / "out")
    assert result.exit_code == 1
    said = " ".join(result.stderr.split())
    assert "no candidate was found in 10 images" in said or "in so few images" in said, said
    assert not (tmp_path / "out" / "calibration.json").exists()
