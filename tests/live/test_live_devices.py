"""``sonocal live`` of a tracker and a frame grabber that have no server."""

import threading

import numpy as np
import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal import InputError, devices
from sonocal.cli import main
from sonocal.simulation.sweep import NEEDLE
from sonocal.targets.toml_file import write_lines
from tests.builders.live import swept
from tests.builders.tracker_devices import Played

DEVICES = ["--tracker", "optitrack", "--video", "/dev/video0"]


@pytest.fixture
def needle(tmp_path):
    write_lines([NEEDLE], tmp_path / "needle.toml")
    return tmp_path / "needle.toml"


def run(needle, *words):
    before = set(threading.enumerate())
    done = CliRunner().invoke(
        main, ["live", *words, "--lines", str(needle), "--no-report", "-o", str(needle.parent / "out")]
    )
    assert not [one for one in threading.enumerate() if one not in before and one.is_alive()]
    return done


def test_devices_without_a_server_are_calibrated_and_let_go(needle, monkeypatch):
    recording = swept(80)
    played = Played(recording)
    monkeypatch.setattr(devices, "open_tracker", lambda text, tools: played)
    monkeypatch.setattr(devices, "open_video", lambda text: played)
    done = run(needle, *DEVICES)
    assert done.exit_code in {0, 1}, done.output
    assert "the images ended" in done.output
    assert played.closed == 2
    kept = sc.read_recording(needle.parent / "out" / "recording.mhd")
    assert len(kept) == len(recording)
    for name, one in recording.poses.items():
        there = kept.poses[name].valid
        assert there.any()  # a busy machine leaves gaps longer than what is bridged
        np.testing.assert_allclose(kept.poses[name].matrices[there], one.matrices[there], atol=1e-4)


def test_a_tracker_that_fails_ends_it_and_what_came_is_kept(needle, monkeypatch):
    recording = swept(40)

    class Fails(Played):
        def read(self, timeout_s):
            if self._read == 40:
                raise InputError("optitrack: the cable was pulled")
            return super().read(timeout_s)

    played = Fails(recording)
    monkeypatch.setattr(devices, "open_tracker", lambda text, tools: played)
    monkeypatch.setattr(devices, "open_video", lambda text: played)
    done = run(needle, *DEVICES)
    assert "the cable was pulled" in done.output
    assert played.closed == 2
    assert len(sc.read_recording(needle.parent / "out" / "recording.mhd")) > 10


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "give --connect HOST[:PORT] of a server, or --tracker and --video"),
        (["--tracker", "optitrack"], "give --connect HOST[:PORT] of a server, or --tracker and --video"),
        (["--connect", "localhost", *DEVICES], "--connect is for a server"),
        ([*DEVICES, "--tool", "Probe"], "--tool must be NAME=FILE"),
        (["--tracker", "vicon", "--video", "a.avi"], "'vicon' is no tracker that sonocal knows"),
        (["--tracker", "ndi:/dev/ttyUSB0", "--video", "a.avi"], "name each with its file or port"),
        ([*DEVICES, "--tool", "Probe=probe.rom"], "Motive names its rigid bodies itself"),
        (["--tracker", "optitrack:host:99999", "--video", "a.avi"], "must be HOST or HOST:PORT"),
    ],
)
def test_what_is_no_source_is_said_and_nothing_is_written(needle, words, said):
    done = run(needle, *words)
    assert done.exit_code != 0
    assert said in " ".join(done.output.split())
    assert not (needle.parent / "out").exists()
