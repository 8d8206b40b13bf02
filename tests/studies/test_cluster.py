"""A real scheduler and real workers as processes on loopback: killed, joined and restarted, with the same results."""

import json
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest
from click.testing import CliRunner

from sonocal.cli.main import main
from sonocal.errors import InputError
from sonocal.studies import cluster, load_study, run_study, running, threads

pytest.importorskip("distributed")
# Dask's own event loop and sockets end a little after the test that used them.
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]

DEFINITION = """
name = "many"
title = ""
trials = 2400
methods = ["sonocal"]
[factors]
needles = [20, 30]
"""
WAIT_S = 60


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "many.toml"
    path.write_text(DEFINITION)
    return path


@pytest.fixture(scope="module")
def reference(study, tmp_path_factory):
    with threads() as workers:
        return run_study(load_study(study), tmp_path_factory.mktemp("reference"), workers).digest


def wait_until(condition):
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


class Cluster:
    """A scheduler and workers without nannies: one that is killed stays dead."""

    def __init__(self, folder):
        self.folder, self.processes = folder, []
        file = folder / "scheduler.json"
        self.scheduler = self._start(
            "dask_scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            "0",
            "--no-dashboard",
            "--scheduler-file",
            str(file),
        )
        wait_until(lambda: file.exists() and file.read_text().endswith("}"))
        self.address = json.loads(file.read_text())["address"]

    def add_worker(self):
        return self._start("dask_worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard")

    def _start(self, program, *arguments):
        command = [sys.executable, "-m", f"distributed.cli.{program}", *arguments]
        with (self.folder / f"{len(self.processes)}.log").open("wb") as log:
            self.processes.append(subprocess.Popen(command, stdout=log, stderr=log, cwd=self.folder))
        return self.processes[-1]

    def stop(self):
        for process in self.processes:
            process.kill()
            process.wait()


@contextmanager
def started(folder, workers):
    running_cluster = Cluster(folder)
    try:
        yield running_cluster, [running_cluster.add_worker() for _ in range(workers)]
    finally:
        running_cluster.stop()


def shard_count(folder):
    return len(list((folder / "shards").glob("*.npz")))


def test_a_worker_killed_half_way_loses_nothing(study, reference, tmp_path, monkeypatch):
    monkeypatch.setattr(running, "TASK_SECONDS", 0.1)
    with (
        started(tmp_path, 2) as (cluster_, (victim, survivor)),
        cluster.existing(cluster_.address) as workers,
    ):
        wait_until(lambda: workers.count() == 2)
        killed_at = []

        def kill_half_way(done, total):
            if done >= total / 3 and not killed_at:
                victim.kill()
                killed_at.append(done)

        store = run_study(load_study(study), tmp_path / "out", workers, progress=kill_half_way)
        assert killed_at
        assert killed_at[0] < 4800
        assert victim.wait() != 0
        assert survivor.poll() is None
        assert store.digest == reference


def test_a_client_killed_half_way_is_continued_by_workers_that_joined_later(study, reference, tmp_path):
    out = tmp_path / "out"
    with started(tmp_path, 1) as (cluster_, _):
        command = [sys.executable, "-m", "sonocal", "study", str(study), "-o", str(out)]
        command += ["--scheduler", cluster_.address, "--no-figure"]
        client = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_until(lambda: shard_count(out) >= 2)
        client.kill()
        assert client.wait() != 0
        assert not json.loads((out / "manifest.json").read_text())["complete"]
        done = shard_count(out)
        cluster_.add_worker()
        assert subprocess.run(command, check=False, capture_output=True).returncode == 0
        assert shard_count(out) > done
    assert json.loads((out / "manifest.json").read_text())["digest"] == reference


def test_local_worker_processes_give_the_same(study, reference, tmp_path):
    with cluster.local(2) as workers:
        assert workers.count() == 2
        assert run_study(load_study(study), tmp_path, workers).digest == reference


def test_a_scheduler_that_dies_is_one_sentence_and_what_was_done_is_kept(
    study, reference, tmp_path, monkeypatch
):
    monkeypatch.setattr(running, "TASK_SECONDS", 0.1)
    out = tmp_path / "out"
    with (
        started(tmp_path, 1) as (cluster_, _),
        pytest.raises(InputError, match="the scheduler has gone; results so far are kept"),
        cluster.existing(cluster_.address) as workers,
    ):
        run_study(
            load_study(study), out, workers, progress=lambda done, _: done and cluster_.scheduler.kill()
        )
    assert shard_count(out) > 0
    with threads() as workers:
        assert run_study(load_study(study), out, workers).digest == reference


def test_nobody_at_the_address_is_one_sentence(study, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_SECONDS", 0.5)
    done = CliRunner().invoke(
        main, ["study", str(study), "-o", str(tmp_path / "out"), "--scheduler", "tcp://127.0.0.1:9"]
    )
    assert done.exit_code == 1
    assert "tcp://127.0.0.1:9: no Dask scheduler answers there" in done.output
    assert not (tmp_path / "out").exists()


def test_a_scheduler_without_workers_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_SECONDS", 2)
    with (
        started(tmp_path, 0) as (cluster_, _),
        pytest.raises(InputError, match="the scheduler has no workers; start some with"),
        cluster.existing(cluster_.address),
    ):
        pass


def test_workers_and_a_scheduler_together_are_refused(study):
    done = CliRunner().invoke(
        main, ["study", str(study), "--workers", "2", "--scheduler", "tcp://127.0.0.1:9"]
    )
    assert done.exit_code == 2
    assert "not both" in done.output
