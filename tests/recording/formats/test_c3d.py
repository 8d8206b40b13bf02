"""C3D files, against the markers that they were written from; ezc3d reads them, too."""

import numpy as np
import pytest

from sonocal import FormatError, InputError
from sonocal.recording import summarize
from sonocal.recording.formats import read_recording
from sonocal.targets import Point
from tests.builders.recordings import random_poses
from tests.builders.tables import N
from tests.builders.trackers import SHAPE, c3d_file, marker_places

pytest.importorskip("c3d", reason="the package c3d is not installed")
LABELS = [f"Probe:{name}" for name in "abcd"]
MODEL = [Point(name, "Probe", place) for name, place in zip("abcd", SHAPE, strict=True)]


def some_poses():
    return random_poses(np.random.default_rng(0), N)


@pytest.mark.parametrize("unit", ["mm", "cm", "m", "in"])
def test_markers_have_the_pose_of_their_body_whatever_the_unit(tmp_path, unit):
    matrices = some_poses()
    c3d_file(tmp_path / "a.c3d", marker_places(matrices), LABELS, unit, hidden={(2, 0), (4, 0), (4, 1)})
    recording = read_recording(tmp_path / "a.c3d", markers=MODEL)
    probe = recording.poses["tracker_from_probe"]
    seen = np.arange(N) != 4
    np.testing.assert_array_equal(probe.valid, seen)
    np.testing.assert_allclose(probe.matrices[seen, :3, :3], matrices[seen, :3, :3], atol=1e-5)
    np.testing.assert_allclose(probe.matrices[seen, :3, 3], matrices[seen, :3, 3], atol=1e-3)
    np.testing.assert_allclose(recording.times, np.arange(N) / 100)


def test_places_are_those_that_ezc3d_reads(tmp_path):
    ezc3d = pytest.importorskip("ezc3d", reason="ezc3d is not installed")
    c3d_file(tmp_path / "a.c3d", marker_places(some_poses()), LABELS)
    probe = read_recording(tmp_path / "a.c3d", markers=MODEL).poses["tracker_from_probe"].matrices
    theirs = ezc3d.c3d(str(tmp_path / "a.c3d"))["data"]["points"][:3]  # (3, M, N)
    np.testing.assert_allclose(marker_places(probe), theirs.transpose(2, 1, 0), atol=1e-3)


def test_a_file_that_does_not_say_its_unit_is_doubted(tmp_path):
    c3d_file(tmp_path / "a.c3d", marker_places(some_poses()), LABELS)
    (tmp_path / "a.c3d").write_bytes((tmp_path / "a.c3d").read_bytes().replace(b"UNITS", b"OTHER"))
    codes = [one.code for one in summarize(read_recording(tmp_path / "a.c3d")).diagnostics]
    assert "implausible-units" in codes


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (lambda b: b[:2000], FormatError, "a.c3d: is cut short: it says 12 frames and holds "),
        (lambda b: b[:600], FormatError, "a.c3d: is damaged ("),
        (
            lambda b: b.replace(b"mm", b"ft"),
            InputError,
            "a.c3d: its unit (POINT:UNITS) is 'ft'; export mm, cm, m or",
        ),
        (
            lambda b: b.replace(b"Probe:", b"Probe_"),
            InputError,
            "a.c3d: no tool has 3 markers or more; label them",
        ),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path, change, kind, words):
    c3d_file(tmp_path / "a.c3d", marker_places(some_poses()), LABELS)
    (tmp_path / "a.c3d").write_bytes(change((tmp_path / "a.c3d").read_bytes()))
    with pytest.raises(kind) as caught:
        read_recording(tmp_path / "a.c3d")
    assert str(caught.value).startswith(words)
