"""A session from its first frame to what it exports."""

import json

import click
import pytest

from sonocal.cli import main
from tests.builders.studio import heard, running


def send(socket, number, **edit):
    socket.send(json.dumps({"id": f"e{number}", **edit}))


def test_frames_are_seen_before_anything_is_found(sweep, tmp_path):
    with running(tmp_path / "studio", sweep[0], "--lines", sweep[1]) as one:
        one.cookie()
        with one.events() as socket:
            heard(socket, "work", phase="looking")
            status, headers, content = one.ask("/frames/0")
            assert (status, len(content)) == (200, int(headers["x-width"]) * int(headers["x-height"]))
            assert one.ask("/frames/0?step=4")[1]["x-width"] == str(int(headers["x-width"]) // 4)
            assert one.ask("/frames/48")[0] == one.ask("/frames/0?step=0")[0] == 404


def without_time(name, content):
    """A file but for when it was written."""
    if name == "calibration.json":
        return {key: value for key, value in json.loads(content).items() if key != "created"}
    return content


@pytest.mark.parametrize("touched", [False, True])
def test_what_is_exported_is_what_the_command_line_writes(sweep, tmp_path, touched):
    source, lines = sweep
    with running(tmp_path / "studio", source, "--lines", lines) as one:
        one.cookie()
        with one.events() as first, one.events() as second:
            told = heard(first, "answer")
            frame = told["residuals"][4][0]
            if touched:
                send(first, 1, action="move", frame=frame, target="needle", at_px=[20.5, 30.25])
                assert heard(first, "answer", touched=True) == heard(second, "answer", touched=True)
        status, _, content = one.ask("/export", "POST")
        assert status == 200, content
        names = json.loads(content)["files"]
        fetched = {name: one.ask(f"/files/{name}")[2] for name in names}
        with one.events() as later:  # every page is told
            assert heard(later, "exported")["files"] == names
    written = {path.name: path.read_bytes() for path in (tmp_path / "studio" / "export").iterdir()}
    assert fetched == written
    points = ["--points", str(tmp_path / "studio" / "export" / "points.csv")] if touched else []
    command = [
        "calibrate",
        str(source),
        "--lines",
        str(lines),
        *points,
        "-o",
        str(tmp_path / "own"),
        "--no-report",
    ]
    main.main(command, standalone_mode=False)
    for name in ("calibration.json", "observations.csv"):
        assert without_time(name, (tmp_path / "own" / name).read_bytes()) == without_time(name, written[name])
    rows = written["observations.csv"].decode().splitlines()
    assert sum("moved" in row.split(",") for row in rows) == touched
    assert {"plus.xml", "ImageToProbe-itk.tfm", "ImageToProbe-slicer.tfm", "report.html"} <= set(names)


def test_undo_to_the_start_is_the_start_again_also_in_a_later_run(sweep, tmp_path):
    source, lines = sweep
    with running(tmp_path / "studio", source, "--lines", lines) as one, one.cookie().events() as socket:
        first = heard(socket, "answer")
        frames = [row[0] for row in first["residuals"][:2]]
        send(socket, 1, action="drop", frame=frames[0], target="needle")
        fewer = heard(socket, "answer", touched=True)
        assert fewer["fit"]["of"] == first["fit"]["of"] - 1
        send(socket, 2, action="move", frame=frames[1], target="needle", at_px=[5, 5])
        heard(socket, "kept", id="e2")
    with running(tmp_path / "studio", source, "--lines", lines) as one, one.cookie().events() as socket:
        heard(socket, "answer", touched=True)
        send(socket, 3, action="undo")
        assert (
            heard(socket, "answer", revision=None or heard(socket, "marks")["revision"])["fit"]
            == fewer["fit"]
        )
        send(socket, 4, action="undo")
        last = heard(socket, "answer", touched=False)
        assert last["fit"] == first["fit"]
        assert last["verdict"] == first["verdict"]


@pytest.mark.parametrize(
    ("edit", "sentence"),
    [
        ({"action": "move", "frame": 99, "target": "needle", "at_px": [1, 1]}, "has no frame 99"),
        ({"action": "move", "frame": 1, "target": "wire", "at_px": [1, 1]}, "is none of needle"),
        ({"action": "move", "frame": 1, "target": "needle", "at_px": [1, 1e9]}, "is not in the image"),
        ({"action": "move", "frame": 1, "target": "needle"}, "is not in the image"),
        ({"action": "drop", "frame": 2000, "target": "needle"}, "has no sighting"),
        ({"action": "undo"}, "there is nothing to undo"),
        ({"action": "explode"}, "this is no edit"),
    ],
)
def test_an_edit_that_means_nothing_is_refused_and_not_kept(studio, edit, sentence):
    with studio.events() as socket:
        heard(socket, "answer")
        send(socket, 1, **edit)
        assert sentence in heard(socket, "refused")["sentence"]


def test_a_table_is_looked_at_too_and_its_own_file_is_not_written(sweep, tmp_path):
    from sonocal.observations import write_observations
    from sonocal.simulation.scene import simulate_observations

    table = tmp_path / "rows.csv"
    write_observations(simulate_observations(2, 40, outlier_share=0.1, seed=1).observations, table)
    before = table.read_bytes()
    with running(tmp_path / "studio", table) as one, one.cookie().events() as socket:
        told = heard(socket, "answer")
        worst = max(told["residuals"], key=lambda row: row[2])
        send(socket, 1, action="drop", frame=worst[0], target=worst[1])
        fewer = heard(socket, "answer", touched=True)
        assert fewer["fit"]["of"] == told["fit"]["of"] - 1
        assert one.ask("/export", "POST")[0] == 200
    assert table.read_bytes() == before


def test_a_folder_of_others_is_refused(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(click.ClickException, match="holds other files than the studio's"):
        main.main(["studio", "-o", str(tmp_path), "--no-browser"], standalone_mode=False)
