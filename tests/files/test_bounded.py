"""Files of any shape end in a sentence, soon and in little memory; nothing in them reaches a terminal but text."""

import os
import subprocess
import sys

import pytest

import sonocal as sc
from sonocal.cli.main import main
from sonocal.files.tables import LONGEST_TEXT
from sonocal.files.toml import LONGEST_LINE, MOST_PARTS
from sonocal.files.xml import DEEPEST
from sonocal.observations import observations_csv
from sonocal.simulation.scene import simulate_observations
from sonocal.targets import read_device_set, read_lines

READ = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
from sonocal import SonocalError
from sonocal.cli.formats import format_of
from pathlib import Path
path = Path(sys.argv[1])
try:
    format_of(path).read(path)
except SonocalError as error:
    print(error)
"""
NEEDLE = '[[line]]\nname = "a"\nframe = "Needle"\nfrom_mm = [0.0, 0.0, 0.0]\nto_mm = [0.0, 0.0, -333.0]\n'


def read_apart(path):
    """What another process says of a file, in 2 GB of address space and a minute."""
    pytest.importorskip("resource", reason="no limits of memory here")
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path)], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def long_cell(folder):
    lines = observations_csv(simulate_observations(2, 30, seed=1).observations).decode().splitlines()
    lines = [f"{line},{'note' if i == 0 else 'x' * 50_000 if i == 5 else ''}" for i, line in enumerate(lines)]
    (folder / "long.csv").write_text("\n".join(lines))
    return folder / "long.csv"


def deep_xml(folder):
    (folder / "deep.xml").write_text("<PlusConfiguration>" + "<a>" * 1_000_000)
    return folder / "deep.xml"


def deep_key(folder):
    (folder / "deep.toml").write_text(NEEDLE + "a." * 100_000 + "a = 1\n")
    return folder / "deep.toml"


def deep_keys(folder):
    (folder / "keys.toml").write_text(NEEDLE + "".join(f"{'a.' * 400}b{i} = 1\n" for i in range(200)))
    return folder / "keys.toml"


def deep_json(folder):
    (folder / "deep.json").write_text('{"format": "sonocal-calibration", "a": ' + "[" * 1_000_000)
    return folder / "deep.json"


@pytest.mark.parametrize("make", [long_cell, deep_xml, deep_key, deep_keys, deep_json])
def test_what_grows_without_end_is_refused_in_a_sentence(make, tmp_path):
    said = read_apart(make(tmp_path))
    assert said.count("\n") == 1
    assert said.strip()


def test_sound_files_are_far_from_the_bounds(tmp_path):
    wires = "".join(NEEDLE.replace('"a"', f'"wire {i}"') for i in range(1000))
    (tmp_path / "wires.toml").write_text(wires)
    assert len(read_lines(tmp_path / "wires.toml")[0]) == 1000
    assert LONGEST_TEXT >= 100
    assert LONGEST_LINE >= 500
    assert MOST_PARTS >= 10
    nested = "<PlusConfiguration>" + "<a>" * (DEEPEST - 1) + "</a>" * (DEEPEST - 1) + "</PlusConfiguration>"
    (tmp_path / "a.xml").write_text(nested)
    assert read_device_set(tmp_path / "a.xml").wires == ()
    (tmp_path / "a.xml").write_text(nested.replace("<a></a>", "<a><a></a></a>"))
    with pytest.raises(sc.FormatError, match=f"more than {DEEPEST} deep"):
        read_device_set(tmp_path / "a.xml")


def test_numbers_in_a_row_are_no_deep_key(tmp_path):
    (tmp_path / "a.toml").write_text(
        NEEDLE.replace("[0.0, 0.0, 0.0]", "[\n  0.0, 0.0, 0.0,\n]") + "# 1.2.3.4.5\n"
    )
    assert [line.name for line in read_lines(tmp_path / "a.toml")[0]] == ["a"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name here")
@pytest.mark.parametrize("special", ["/dev/zero", "/dev/null", "pipe"])
def test_what_is_no_file_keeps_nobody_waiting(special, tmp_path):
    path = tmp_path / "a.csv"
    if special == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(special)
    assert "is a pipe or a device; write what comes from it to a file first" in read_apart(path)


@pytest.mark.parametrize("command", [["info"], ["calibrate", "-o", "out", "--no-report"]])
def test_no_control_character_of_a_file_reaches_a_terminal(command, tmp_path, monkeypatch):
    from click.testing import CliRunner

    monkeypatch.chdir(tmp_path)
    rows = simulate_observations(2, 20, seed=1).observations
    bad = "x\x1b]0;title\x07\x1b[31m\x9b2J\u202e"
    named = sc.Observations(
        rows.points_px, rows.segments_mm, target=[bad] * 20, split=[bad] * 20, extra={"n" + bad: [bad] * 20}
    )
    sc.write_observations(named, "a.csv")
    for arguments in (
        [*command, "a.csv"],
        [*command, "a.csv", "--json", *(["--overwrite"] * (command[0] == "calibrate"))],
    ):
        shown = CliRunner(env={"TERM": "xterm-256color", "FORCE_COLOR": "1"}).invoke(main, arguments)
        assert shown.exit_code == 0, shown.output
        kept = shown.output.replace("\x1b[", "")  # colours of the console's own
        for control in ("\x1b", "\x07", "\x9b", "\u202e", "]0;title\x07"):
            assert control not in kept
    refused = CliRunner().invoke(main, ["calibrate", "a.csv", "--fit-split", "none", "-o", "other"])
    assert refused.exit_code == 1
    assert not {"\x1b", "\x07", "\x9b", "\u202e"} & set(refused.output)


INTERRUPTED = """
import _thread, signal, threading
import numpy as np
import sonocal as sc
rng = np.random.default_rng(0)
rows = sc.Observations(rng.uniform(0, 500, (2000, 2)), 100 * rng.normal(size=(2000, 2, 3)))
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
threading.Timer(0.3, _thread.interrupt_main).start()
try:
    sc.calibrate(rows, max_samples=10**9, confidence=1 - 1e-12)
except KeyboardInterrupt:
    print("stopped")
"""


def test_ctrl_c_ends_the_cores_long_work():
    """Hours of samples: without a look at the signals the process would be killed at the end of its minute."""
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.stdout, done.returncode) == ("stopped\n", 0), done.stderr


LOG = "ToolCount,ToolInfo,Frame#,PortHandle,Face#,TransformStatus,Q0,Qx,Qy,Qz,Tx,Ty,Tz,Error,#Markers\n"
VICON = "Objects\n100\n,,A:A\nFrame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ\n,,,,,,mm,mm,mm\n"
POSES = "t,qw,qx,qy,qz,x,y,z\n"
TOOLS = "t," + ",".join(f"T{i}_{k}" for i in range(20_000) for k in ("qw", "qx", "qy", "qz", "x", "y", "z"))
OF_TRACKERS = {
    "a long cell": POSES + '0,1,0,0,0,1,2,"' + "3" * 20_000_000 + '"\n',
    "a long name": POSES.strip() + " " * 20_000_000 + "\n0,1,0,0,0,1,2,3\n",
    "a long cell of a log": LOG + '1,"' + "x " * 10_000_000 + '"\n',
    "a wide row": POSES + "0" + ",1" * 3_000_000 + "\n",
    "a wide row of a log": LOG + "1,A,1,P,1,OK,1,0,0,0,1,2,3,0,0" + ",1" * 3_000_000 + "\n",
    "many tools": TOOLS + "\n0" + ",1,0,0,0,1,2,3" * 20_000 + ",4\n",
    "another tool in every row": LOG
    + "".join(f"1,T{i},{i},P,1,OK,1,0,0,0,1,2,3,0,0\n" for i in range(100_000)),
    "a cut log": LOG + "1,A,1,P,1,OK,1,0,0,0,1,2,3,0,0\n" * 1000 + "1,A,1,P,1,OK,1,0",
    "a cut trajectory": "0 1 2 3 0 0 0 1\n" * 1000 + "0 1 2",
    "a cut header": VICON[:60],
    "a wide line of a trajectory": "0 1 2 3 0 0 0 1\n" + "1 " * 3_000_000,
}


@pytest.mark.parametrize("name", OF_TRACKERS)
def test_logs_of_trackers_of_any_shape_end_in_a_sentence(name, tmp_path):
    (tmp_path / "a.csv").write_text(OF_TRACKERS[name])
    said = read_apart(tmp_path / "a.csv")
    assert said.count("\n") == 1
    assert said.startswith("a.csv")
