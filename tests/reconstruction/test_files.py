"""Volumes in files: whole or not there, and where other programs see them."""

import dataclasses
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from benchmarks.simulators.fields import path, probe_from_image, recorded
from click.testing import CliRunner

import sonocal as sc
from sonocal import FormatError, InputError, UnsupportedError
from sonocal.cli.main import main
from sonocal.recording.formats import write_recording
from sonocal.recording.frames import MappedFrames

MASK = np.ones((80, 100), dtype=bool)


def made(target=None, recording=None, **options):
    recording = recorded(path(12)) if recording is None else recording
    return sc.reconstruct(recording, probe_from_image(), target, **{"mask": MASK, **options})


@pytest.mark.parametrize("axes", ["lps", "ras"])
@pytest.mark.parametrize("suffix", [".mha", ".nrrd"])
def test_simpleitk_sees_the_voxels_where_they_are(tmp_path, suffix, axes):
    itk = pytest.importorskip("SimpleITK")
    file = tmp_path / f"volume{suffix}"
    volume = made(file, axes=axes, spacing_mm=(0.5, 0.75, 1.0), coverage=True)
    image = itk.ReadImage(str(file))
    np.testing.assert_array_equal(itk.GetArrayFromImage(image), volume.values)
    np.testing.assert_array_equal(
        itk.GetArrayFromImage(itk.ReadImage(str(tmp_path / f"volume-coverage{suffix}"))), volume.coverage
    )
    sign = {"lps": [1, 1, 1], "ras": [-1, -1, 1]}[axes]  # ITK's own axes are LPS
    for index in ([0, 0, 0], [3, 5, 7]):
        place = volume.grid.origin_mm + volume.grid.spacing_mm * index
        np.testing.assert_allclose(image.TransformIndexToPhysicalPoint(index), sign * place, atol=1e-9)


def test_a_file_is_what_memory_holds(tmp_path):
    whole = made(coverage=True, error=True, noise_mm=0.2)
    filed = made(tmp_path / "volume.mha", coverage=True, error=True, noise_mm=0.2)
    for name in ("values", "coverage", "error_um"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(filed, name))
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "volume-coverage.mha",
        "volume-error-um.mha",
        "volume.mha",
    ]
    again = sc.read_recording(tmp_path / "volume.mha")
    np.testing.assert_array_equal(again.frames[0], whole.values)


def test_a_full_disk_leaves_nothing(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full, raising=False)
    with pytest.raises(InputError, match=r"volume\.mha: cannot be written \(No space left on device\)"):
        made(tmp_path / "volume.mha")
    assert not list(tmp_path.iterdir())


def test_a_recording_that_breaks_off_leaves_nothing(tmp_path):
    recording, left = recorded(path(12)), iter(range(10))

    def breaks(image):
        if next(left, None) is None:
            raise FormatError("sweep.mha, frame 9: the file ends within it; copy or record it again")
        return image

    broken = dataclasses.replace(
        recording, frames=MappedFrames(recording.frames, breaks, recording.frames.shape)
    )
    with pytest.raises(FormatError, match="ends within it"):
        made(tmp_path / "volume.mha", broken, coverage=True)
    assert not list(tmp_path.iterdir())


def test_who_is_killed_leaves_no_volume(tmp_path):
    write_recording(recorded(path(60)), tmp_path / "sweep.igs.mha")
    np.savetxt(tmp_path / "matrix.txt", probe_from_image())
    words = ["reconstruct", "sweep.igs.mha", "matrix.txt", "-o", "volume.mha", "--spacing", "0.06"]
    running = subprocess.Popen([sys.executable, "-m", "sonocal", *words], cwd=tmp_path)
    for _ in range(600):
        time.sleep(0.05)
        if any(p.name.startswith(".volume.mha") for p in tmp_path.iterdir()):
            break
    running.send_signal(signal.SIGKILL)
    running.wait()
    assert not (tmp_path / "volume.mha").exists()


def empty_poses(recording):
    poses = recording.poses["tracker_from_probe"]
    gone = dataclasses.replace(poses, valid=np.zeros(len(recording), dtype=bool))
    return dataclasses.replace(recording, poses={"tracker_from_probe": gone})


def test_what_makes_no_volume_is_said_in_a_sentence(tmp_path):
    file, sweep = tmp_path / "volume.mha", recorded(path(5))
    for recording, options, words in [
        (empty_poses(sweep), {}, "none of its 5 images has a valid pose of Probe in Tracker"),
        (sweep, {"bounds_mm": [[900, 900, 900], [950, 950, 950]]}, "none of its 5 images crosses bounds_mm"),
        (sweep, {"spacing_mm": 1e-4}, "give a larger spacing"),
        (sweep, {"reference": "Patient"}, "nothing connects Probe to Patient"),
        (sweep, {"mask": np.ones((3, 3), dtype=bool)}, "mask must be 100 x 80 px"),
        (sweep, {"interpolation": "cubic"}, "interpolation must be one of between, nearest, linear"),
        (sweep, {"spacing": 3}, "'spacing' is no option of reconstruct"),
        (sweep, {"smooth": True}, "smooth must know the tracker's own noise"),
        (sweep, {"error": True}, "error must rest on something"),
    ]:
        with pytest.raises(InputError, match=words):
            made(file, recording, **options)
        assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match=r"volumes are written as \.mha or \.nrrd"):
        made(tmp_path / "volume.tif", sweep)
    with pytest.raises(InputError, match="calibration must be a calibration"):
        sc.reconstruct(sweep, np.zeros((3, 3)))
    with pytest.raises(UnsupportedError, match="float32 are not put into volumes"):
        floats = MappedFrames(sweep.frames, lambda image: image.astype(np.float32), sweep.frames.shape)
        floats.dtype = np.dtype(np.float32)
        made(file, dataclasses.replace(sweep, frames=floats))


def test_a_page_that_cannot_be_made_leaves_the_volume(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_recording(recorded(path(12)), "sweep.igs.mha")
    np.savetxt("matrix.txt", probe_from_image())
    monkeypatch.setitem(sys.modules, "jinja2", None)
    done = run("reconstruct", "sweep.igs.mha", "matrix.txt", "-o", "volume.mha")
    assert done.exit_code == 0, done.output
    assert "Note: the report needs jinja2" in done.output
    assert sorted(p.name for p in tmp_path.glob("volume*")) == ["volume.mha"]


def run(*words):
    return CliRunner(env={"COLUMNS": "200", "TERM": "dumb"}).invoke(main, [str(word) for word in words])


def test_the_command_writes_what_the_function_makes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_recording(recorded(path(12)), "sweep.igs.mha")
    np.savetxt("matrix.txt", probe_from_image())
    options = ["--spacing", "0.5,0.5,1", "--bounds", "-15,15,50,10,30,80", "--coverage", "--threads", "2"]
    done = run("reconstruct", "sweep.igs.mha", "matrix.txt", "-o", "volume.mha", *options)
    assert done.exit_code == 0, done.output
    assert "12 images: 51 x 31 x 31 voxels of 0.5 x 0.5 x 1 mm in Tracker" in done.output
    assert sorted(p.name for p in tmp_path.glob("volume*")) == [
        "volume-coverage.mha",
        "volume.html",
        "volume.mha",
    ]
    assert "sweep.igs.mha" in (tmp_path / "volume.html").read_text("utf-8")
    plain = run("reconstruct", "sweep.igs.mha", "matrix.txt", "-o", "plain.mha", "--no-report")
    assert plain.exit_code == 0, plain.output
    assert not (tmp_path / "plain.html").exists()
    both = run(
        "reconstruct", "sweep.igs.mha", "matrix.txt", "-o", "v.mha", "--threads", "2", "--workers", "2"
    )
    assert both.exit_code == 2
    assert "give --threads or --workers, not both" in both.output
    nobody = run("reconstruct", "sweep.igs.mha", "matrix.txt", "-o", "v.mha", "--scheduler", "no://where")
    assert nobody.exit_code == 1
    assert "no Dask scheduler answers there" in nobody.output
    again = run("reconstruct", "sweep.igs.mha", "matrix.txt", "-o", "volume.mha")
    assert again.exit_code == 1
    assert "is there already" in again.output
    wrong = run(
        "reconstruct",
        "sweep.igs.mha",
        "matrix.txt",
        "-o",
        "v.mha",
        "--like-plus",
        "matrix.txt",
        "--spacing",
        "1",
    )
    assert wrong.exit_code == 2
    assert "--spacing is not for --like-plus" in wrong.output
