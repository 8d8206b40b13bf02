"""Findings that are looked for when they are first read."""

import copy
import pickle
from threading import Barrier, Thread

import numpy as np
from benchmarks.comparison import needle_scan
from benchmarks.simulators.scans import scan
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.findings import Diagnostic, Findings, reading_order

SLIPPED = {"slip": (np.array([0.0, 0.05, 0.0]), np.array([4.0, 0.0, 0.0]))}

findings = st.lists(
    st.builds(
        Diagnostic,
        st.sampled_from(["latency", "marker-slipped", "weak-motion", "gaps"]),
        st.sampled_from(["warning", "info"]),
        st.text(max_size=3),
        st.just("nothing"),
    ),
    max_size=5,
)


def slipped():
    return sc.calibrate(scan(3, **SLIPPED).observations)


def as_read(one):
    """Warnings first, and of these what explains others."""
    return one.severity != "warning", reading_order(one.code)


@given(st.lists(findings, max_size=4))
def test_what_is_looked_for_is_found_once_with_warnings_first(parts):
    looked = []

    def look(part):
        looked.append(part)
        return part

    found = Findings(looks=[lambda part=part: look(part) for part in parts])
    assert not looked
    assert len(found) == sum(map(len, parts))
    everything = [one for part in parts for one in part]
    assert list(found) == sorted(everything, key=as_read)
    assert found == tuple(found)
    assert len(looked) == len(parts)


@given(findings, findings)
def test_further_findings_wait_for_those_before_them(first, further):
    looked = []
    found = Findings(looks=[lambda: looked.append(1) or first]).with_further(further)
    assert not looked
    assert list(found) == sorted([*first, *further], key=as_read)
    assert list(Findings(first)) == first  # those of a file keep the file's order


def test_calibrating_alone_looks_for_nothing(monkeypatch):
    asked = []
    monkeypatch.setattr("sonocal.calibration.evidence.check_setup", lambda *_, **__: asked.append(1) or ())
    found = slipped()
    assert not asked
    assert "marker-slipped" not in [one.code for one in found.warnings]
    assert found.diagnostics[:0] == ()
    assert asked == [1]


def test_copies_have_the_findings_of_the_first():
    found = slipped()
    copies = [copy.copy(found), copy.deepcopy(found), pickle.loads(pickle.dumps(found))]
    codes = [one.code for one in found.diagnostics]
    assert "marker-slipped" in codes
    for other in copies:
        assert [one.code for one in other.diagnostics] == codes


def test_arrays_changed_after_calibrating_change_no_finding():
    rows = scan(3, **SLIPPED).observations
    points, segments = rows.points_px.copy(), rows.segments_mm.copy()
    found = sc.calibrate(sc.Observations(points, segments, frame=rows.frame, extra=rows.extra))
    points[:], segments[:] = 0.0, 1.0
    assert [one.message for one in found.diagnostics] == [one.message for one in slipped().diagnostics]


def test_threads_that_read_at_once_read_the_same():
    found, gate, seen = slipped(), Barrier(8), []

    def read():
        gate.wait()
        seen.append(found.diagnostics[:])

    threads = [Thread(target=read) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(seen) == 8
    assert all(one == seen[0] for one in seen)


def test_a_mirrored_volume_that_nothing_agrees_with_is_no_error_of_its_own():
    # The mirror's best sample may be an image of no size, or one that no row agrees with.
    for seed in (142, 198, 244):
        rng = np.random.default_rng([seed, 3, 6, 6, 3])
        truth = (Rotation.random(random_state=seed).as_matrix(), rng.uniform(-100, 100, 3))
        rows = needle_scan(rng, truth, 3, 12).select(np.arange(12))
        assert "flipped-image" not in {finding.code for finding in sc.calibrate(rows).diagnostics}
