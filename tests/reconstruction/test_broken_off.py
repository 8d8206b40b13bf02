"""Who is killed, or runs out of room, at whatever moment, has no half volume."""

import os
import signal
import tempfile
from pathlib import Path

import numpy as np
import pytest
from benchmarks.simulators.fields import path, probe_from_image, recorded

import sonocal as sc
from sonocal import InputError
from sonocal.reconstruction import files, pieces, store

MASK = np.ones((80, 100), dtype=bool)
NAMES = ("volume.mha", "volume-coverage.mha", "volume-error-um.mha")
MOST_MOMENTS = 60
pytestmark = pytest.mark.skipif(
    not hasattr(os, "fork"), reason="needs a process that can be killed at a line"
)


def made(folder):
    return sc.reconstruct(
        recorded(path(12)),
        probe_from_image(),
        folder / "volume.mha",
        mask=MASK,
        coverage=True,
        error=True,
        noise_mm=0.2,
        threads=3,
    )


def in_a_child(work):
    """How a process ended that did some work: 0, 1 with a sentence, or the negative number of a signal."""
    child = os.fork()
    if child == 0:
        code = 2
        try:
            work()
            code = 0
        except InputError:
            code = 1
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def killed_at(moment, folder):
    """Make a volume, and be killed at the n-th time that anything is written."""
    count = iter(range(MOST_MOMENTS))

    def before(work):
        def counted(*given, **named):
            if next(count) == moment:
                os.kill(os.getpid(), signal.SIGKILL)
            return work(*given, **named)

        return counted

    files._take_room = before(files._take_room)
    store.Store.put = before(store.Store.put)
    Path.chmod, Path.replace = before(Path.chmod), before(Path.replace)
    made(folder)


def test_who_is_killed_at_any_moment_has_whole_volumes_or_none(tmp_path):
    whole = tmp_path / "whole"
    whole.mkdir()
    made(whole)
    for moment in range(MOST_MOMENTS):
        folder = tmp_path / str(moment)
        folder.mkdir()
        end = in_a_child(lambda: killed_at(moment, folder))  # noqa: B023 - runs before the next begins
        there = [name for name in NAMES if (folder / name).exists()]
        for name in there:
            assert (folder / name).read_bytes() == (whole / name).read_bytes(), (moment, name)
        if end == 0:
            assert there == list(NAMES)
            break
        assert end == -signal.SIGKILL
    assert moment > 12


def test_who_runs_out_of_room_has_none(tmp_path):
    resource = pytest.importorskip("resource")
    whole = tmp_path / "whole"
    whole.mkdir()
    voxels = made(whole).grid.voxels  # a byte each in the volume, two in each channel
    for size in (100, voxels // 2, voxels + voxels // 2):
        folder = tmp_path / str(size)
        folder.mkdir()

        def limited(size=size, folder=folder):
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
            made(folder)

        assert in_a_child(limited) == 1
        assert not list(folder.iterdir())


def test_no_room_for_decoded_images_is_said(tmp_path, monkeypatch):
    class Full:
        def seek(self, _):
            pass

        def write(self, _):
            raise OSError(28, "No space left on device")

        def close(self):
            pass

    monkeypatch.setattr(tempfile, "TemporaryFile", Full)
    monkeypatch.setattr(pieces, "SIDE", 24)
    monkeypatch.setattr("sonocal.reconstruction.making.SUMS_BYTES", 1)
    with pytest.raises(InputError, match=r"decoded images cannot be kept there \(No space left on device\)"):
        made(tmp_path)
    assert not list(tmp_path.iterdir())
