"""Bricks filled by workers make the same volume; what goes wrong with them leaves none."""

import pickle
import tempfile
from concurrent.futures import Executor, Future
from dataclasses import dataclass

import numpy as np
import pytest
from benchmarks.simulators.fields import path, probe_from_image, recorded

import sonocal as sc
from sonocal import InputError
from sonocal.reconstruction import pieces

MASK = np.ones((80, 100), dtype=bool)


class Elsewhere(Executor):
    """What a worker on another machine gets and gives: nothing but bytes."""

    def __init__(self):
        self.tasks, self.before = 0, lambda: None

    def submit(self, function, /, *arguments):
        future = Future()
        self.tasks += 1
        self.before()
        try:
            function, arguments = pickle.loads(pickle.dumps((function, arguments)))
            future.set_result(pickle.loads(pickle.dumps(function(*arguments))))
        except Exception as error:
            future.set_exception(error)
        return future


@dataclass
class Workers:
    executor: Executor

    def count(self):
        return 2


def made(target=None, workers=None, recording=None, **options):
    recording = recorded(path(40)) if recording is None else recording
    told = {"mask": MASK, "coverage": True, **options}
    return sc.reconstruct(recording, probe_from_image(), target, workers=workers, **told)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("mode", ["nearest", "linear", "between"])
def test_workers_change_nothing(tmp_path, monkeypatch, mode, dtype):
    sweep = recorded(path(40), dtype=dtype)
    options = {"recording": sweep, "interpolation": mode, "error": True, "noise_mm": 0.2}
    whole = made(**options)
    monkeypatch.setattr(pieces, "SIDE", 24)
    monkeypatch.setattr("sonocal.reconstruction.batches.BATCH_BYTES", 5 * 16000)
    workers, steps = Workers(Elsewhere()), []
    spread = made(
        tmp_path / "volume.mha", workers, progress=lambda done, total: steps.append((done, total)), **options
    )
    for name in ("values", "coverage", "error_um"):
        np.testing.assert_array_equal(getattr(spread, name), getattr(whole, name))
    assert spread.filled == whole.filled
    assert workers.executor.tasks > 20
    assert steps[-1][0] == steps[-1][1]
    assert sorted(p.suffix for p in tmp_path.iterdir()) == [".mha", ".mha", ".mha"]


def test_images_without_a_pose_are_none_of_theirs():
    sweep = recorded(path(30))
    poses = sweep.poses["tracker_from_probe"]
    matrices = poses.matrices.copy()
    matrices[[0, 7, 8, 20]] = np.nan
    lost = sc.Recording(
        sweep.times, sweep.frames, {poses.name: poses.of("Probe", "Tracker", matrices)}, sweep.image
    )
    np.testing.assert_array_equal(
        made(workers=Workers(Elsewhere()), recording=lost).values, made(recording=lost).values
    )


def test_a_worker_that_sees_no_images_is_told_of(tmp_path):
    workers = Workers(Elsewhere())
    workers.executor.before = lambda: [p.unlink() for p in tmp_path.glob("*.images")]
    with pytest.raises(InputError, match="a folder that all machines share"):
        made(tmp_path / "volume.mha", workers)
    assert not list(tmp_path.iterdir())


def test_a_folder_without_room_for_images_is_told_of(tmp_path, monkeypatch):
    make = tempfile.mkstemp

    def full(suffix=None, *more, **options):
        if suffix == ".images":
            raise OSError(28, "No space left on device")
        return make(suffix, *more, **options)

    monkeypatch.setattr(tempfile, "mkstemp", full)
    with pytest.raises(InputError, match="decoded images cannot be kept there for the workers"):
        made(tmp_path / "volume.mha", Workers(Elsewhere()))
    assert not list(tmp_path.iterdir())


def test_workers_of_dask_change_nothing(tmp_path):
    pytest.importorskip("distributed")
    from sonocal.studies import cluster

    with cluster.local(2) as workers:
        spread = made(tmp_path / "volume.nrrd", workers)
    np.testing.assert_array_equal(spread.values, made().values)
