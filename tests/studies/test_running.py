"""A study is done once, whoever does it, and goes on where it stopped."""

import json
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import msgspec
import numpy as np
import pytest

from sonocal.errors import FormatError, InputError, UnsupportedError
from sonocal.studies import Scene, Store, Study, Workers, run_study, running, summarise, threads
from sonocal.studies.store import MANIFEST

STUDY = Study(
    name="small",
    title="",
    trials=900,
    methods=["four_points", "sonocal"],
    scene=Scene(crosswires=2),
    factors={"needles": [5, 8], "sigma_px": [0.5, 1.0]},
)


def digest_of(folder, study=STUDY, **kwargs):
    with threads() as workers:
        return run_study(study, folder, workers, **kwargs).digest


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    return digest_of(tmp_path_factory.mktemp("reference"))


def shards(folder):
    return sorted((folder / "shards").glob("*.npz"))


def test_one_worker_and_many_give_the_same(tmp_path, reference):
    for count in (1, 3):
        with ThreadPoolExecutor(count) as executor:
            workers = Workers(executor, lambda count=count: count)
            assert run_study(STUDY, tmp_path / str(count), workers).digest == reference


@pytest.mark.parametrize("seconds", [0.0, 0.05, 100.0])
def test_the_size_of_tasks_changes_nothing(tmp_path, monkeypatch, reference, seconds):
    monkeypatch.setattr(running, "TASK_SECONDS", seconds)
    assert digest_of(tmp_path) == reference


def test_a_complete_study_is_not_done_again(tmp_path, reference):
    assert digest_of(tmp_path) == reference
    before = {path: path.stat().st_mtime_ns for path in shards(tmp_path)}
    seen = []
    assert digest_of(tmp_path, progress=lambda done, total: seen.append((done, total))) == reference
    assert seen == [(3600, 3600)]
    assert {path: path.stat().st_mtime_ns for path in shards(tmp_path)} == before


def test_what_is_lost_or_damaged_is_done_again(tmp_path, reference):
    digest_of(tmp_path)
    lost, cut, changed, *_ = shards(tmp_path)
    lost.unlink()
    cut.write_bytes(cut.read_bytes()[:-100])
    content = bytearray(changed.read_bytes())
    content[len(content) // 2] ^= 255
    changed.write_bytes(bytes(content))
    assert digest_of(tmp_path) == reference


def test_a_whole_shard_that_is_not_what_was_written_is_done_again(tmp_path, reference):
    """Of another seed, say: nothing in it is damaged, and only the manifest tells."""
    digest_of(tmp_path / "one")
    digest_of(tmp_path / "other", msgspec.structs.replace(STUDY, seed=STUDY.seed + 1))
    (tmp_path / "one" / "shards" / shards(tmp_path / "one")[0].name).write_bytes(
        shards(tmp_path / "other")[0].read_bytes()
    )
    assert digest_of(tmp_path / "one") == reference


def test_more_trials_go_on_from_fewer(tmp_path, reference):
    fewer = msgspec.structs.replace(STUDY, trials=250)
    digest_of(tmp_path, fewer)
    assert digest_of(tmp_path) == reference
    # And fewer are the first of more.
    store = Store(tmp_path, fewer, running.program_version())
    alone = tmp_path / "alone"
    digest_of(alone, fewer)
    other = Store(alone, fewer, running.program_version())
    for index in range(4):
        assert not store.missing(index)
        np.testing.assert_array_equal(store.read(index, "errors"), other.read(index, "errors"))


def test_a_shard_in_two_halves_of_other_runs_is_read_once(tmp_path, reference):
    digest_of(tmp_path)
    store = Store(tmp_path, STUDY, running.program_version())
    names = ("errors", "wire_errors", "bound", "bound_draws")
    whole = {name: store.read(0, name) for name in names}
    for path in shards(tmp_path):
        if path.name.startswith("cell-000"):
            path.unlink()
    overlapping = Store(tmp_path, STUDY, running.program_version())
    for first, last in ((0, 600), (400, 900)):
        overlapping.write(0, first, last, {name: values[first:last] for name, values in whole.items()})
    assert overlapping.missing(0) == []
    np.testing.assert_array_equal(overlapping.read(0, "errors"), whole["errors"])
    np.testing.assert_array_equal(overlapping.read(0, "errors", 1), whole["errors"][:, 1])


def test_a_killed_run_is_continued(tmp_path, reference):
    """The client is killed half way (SIGKILL: it can tidy up nothing), and started again."""
    definition = tmp_path / "small.toml"
    definition.write_text(
        'name = "small"\ntitle = ""\ntrials = 900\nmethods = ["four_points", "sonocal"]\n[scene]\ncrosswires = 2\n'
        "[factors]\nneedles = [5, 8]\nsigma_px = [0.5, 1.0]\n"
    )
    # Slowed down, so that it is surely killed half way.
    program = (
        "import sys, time\nfrom sonocal.studies import trials, running\n"
        "plain = running.run_trials\n"
        "def slow(*arguments):\n    time.sleep(0.1)\n    return plain(*arguments)\n"
        "running.run_trials = slow\nrunning.TASK_SECONDS = 0\n"
        "from sonocal.cli import main\nmain(sys.argv[1:])\n"
    )
    command = [
        sys.executable,
        "-c",
        program,
        "study",
        str(definition),
        "-o",
        str(tmp_path / "out"),
        "--no-figure",
    ]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while len(shards(tmp_path / "out")) < 3 and time.monotonic() < deadline:
        time.sleep(0.02)
    run.kill()
    assert run.wait() != 0
    done = len(shards(tmp_path / "out"))
    assert 3 <= done < 20
    assert not json.loads((tmp_path / "out" / MANIFEST).read_text())["complete"]
    assert digest_of(tmp_path / "out") == reference
    manifest = json.loads((tmp_path / "out" / MANIFEST).read_text())
    assert manifest["complete"]
    assert manifest["digest"] == reference
    assert set(manifest["shards"]) == {path.name for path in shards(tmp_path / "out")}


@pytest.mark.parametrize("change", [{"seed": 1}, {"methods": ["sonocal"]}, {"scene": Scene(sigma_mm=2.0)}])
def test_a_folder_of_another_study_is_refused(tmp_path, change):
    small = msgspec.structs.replace(STUDY, trials=10)
    digest_of(tmp_path, small)
    with pytest.raises(
        InputError, match=f"another study \\(its {next(iter(change))} differs\\); choose another folder"
    ):
        digest_of(tmp_path, msgspec.structs.replace(small, **change))


def test_what_does_not_change_results_may_change(tmp_path):
    small = msgspec.structs.replace(STUDY, trials=10)
    first = digest_of(tmp_path, small)
    assert digest_of(tmp_path, msgspec.structs.replace(small, title="another", question="?")) == first


def test_results_of_another_version_are_refused(tmp_path):
    digest_of(tmp_path, msgspec.structs.replace(STUDY, trials=10))
    manifest = tmp_path / MANIFEST
    manifest.write_text(manifest.read_text().replace('"sonocal": "', '"sonocal": "9.'))
    with pytest.raises(InputError, match="holds results of sonocal 9"):
        digest_of(tmp_path)


def test_a_manifest_that_is_none_is_refused(tmp_path):
    (tmp_path / MANIFEST).write_text("{}")
    with pytest.raises(FormatError, match="is not a study's manifest"):
        digest_of(tmp_path)


def test_a_worker_of_another_version_is_refused(tmp_path, monkeypatch):
    done = running._do
    monkeypatch.setattr(running, "_do", lambda *task: msgspec_replaced(done(*task)))
    with pytest.raises(UnsupportedError, match="a worker runs sonocal 9"):
        digest_of(tmp_path)
    assert not shards(tmp_path)


def msgspec_replaced(done):
    return running._Done(done.results, done.seconds, "9.0")


def test_a_failure_of_a_task_is_raised_and_what_was_done_stays(tmp_path, monkeypatch, reference):
    plain, calls = running.run_trials, []

    def failing(*task):
        calls.append(task)
        if len(calls) == 4:
            raise MemoryError
        return plain(*task)

    monkeypatch.setattr(running, "run_trials", failing)
    with ThreadPoolExecutor(1) as executor, pytest.raises(MemoryError):
        run_study(STUDY, tmp_path, Workers(executor, lambda: 1))
    assert shards(tmp_path)
    monkeypatch.setattr(running, "run_trials", plain)
    assert digest_of(tmp_path) == reference


def test_progress_counts_every_trial(tmp_path):
    seen = []
    digest_of(tmp_path, progress=lambda done, total: seen.append((done, total)))
    assert seen[0] == (0, 3600)
    assert seen[-1] == (3600, 3600)
    assert seen == sorted(seen)


def test_the_summary_counts_all_trials(tmp_path):
    with threads() as workers:
        store = run_study(STUDY, tmp_path, workers)
    for row in summarise(store):
        assert row.trials + row.failed == STUDY.trials * (2 if row.quantity == "pra_mm" else 1)
        assert row.median_low <= row.median <= row.median_high
        assert row.q1 <= row.median <= row.q3 <= row.p95
    errors = store.read(0, "errors")[:, 1, 1, 0]
    (row,) = [
        r
        for r in summarise(store)
        if (r.levels, r.method, r.stage, r.quantity)
        == ({"needles": 5, "sigma_px": 0.5}, "sonocal", "after", "rotation_deg")
    ]
    assert row.median == pytest.approx(np.median(errors), rel=1e-6)
    assert row.p95 == pytest.approx(np.percentile(errors, 95), rel=1e-6)
    assert row.rms == pytest.approx(np.sqrt(np.mean(errors.astype(float) ** 2)), rel=1e-6)
