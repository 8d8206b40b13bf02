"""Calibrations that find where their targets are, too."""

import numpy as np
import pytest
from benchmarks.simulators.places import Noise, image_points, sweep
from benchmarks.simulators.tank import tank_sweep
from hypothesis import given, settings
from hypothesis import strategies as st

import sonocal as sc
from sonocal.calibration.found_targets import target_in_words
from sonocal.calibration.placed import placed_by
from sonocal.errors import DegenerateGeometryError, InputError, UnsupportedError
from sonocal.targets import Line, Point, Unplaced
from tests.builders.tank import both, placed_table, unknown, unplaced_table

KINDS = ["point", "line", "plane"]
few_seeds = st.integers(0, 10**6)


def rms_mm(found, scene):
    places = image_points(scene.dimension)
    there = places @ scene.truth[:3, :3].T + scene.truth[:3, 3]
    return np.sqrt(np.mean(np.sum((found.probe_from_image @ places - there) ** 2, axis=1)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=few_seeds)
@settings(max_examples=4)
def test_the_calibration_and_the_place_are_exact_without_noise(kind, dimension, seed):
    scene = sweep(kind, 25, seed, dimension=dimension)
    found = sc.calibrate(unplaced_table(scene), targets=[unknown(kind)])
    assert rms_mm(found, scene) < 1e-5
    target = found.targets["thread"]
    assert (target.kind, target.frame) == (kind, "Tracker")
    away = scene.place - target.middle_mm
    across = np.array(target.axes)[:, : 4 - len(scene.place)]
    assert np.abs(away @ across).max() < 1e-5
    np.testing.assert_allclose(found.residuals_mm, 0, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_rows_placed_where_the_target_was_found_give_the_same_residuals(kind):
    scene = sweep(kind, 60, 3, Noise())
    table = unplaced_table(scene, image_size_px=(501, 501))
    found = sc.calibrate(table, targets=[unknown(kind)])
    rows = placed_by(found, table)
    assert set(rows.spans) == {KINDS.index(kind) + 1}
    assert not any(name.startswith("probe_from_target") for name in rows.extra)
    from sonocal.calibration.mixed import target_distances

    np.testing.assert_allclose(target_distances(found.probe_from_image, rows), found.residuals_mm, atol=1e-9)
    assert found.fit.inliers >= 0.95 * len(rows)
    assert found.predicted_errors()[2].max() < 6
    assert found.image_size_px == (501, 501)
    assert not [
        one.code for one in found.diagnostics if one.code in {"latency", "wrong-tool-frame", "two-answers"}
    ]


def test_a_calibration_with_places_is_written_and_read(tmp_path):
    scene = sweep("line", 40, 5, Noise())
    found = sc.calibrate(unplaced_table(scene), targets=[unknown("line")])
    found.save(tmp_path / "a.json")
    again = sc.load(tmp_path / "a.json")
    assert again.targets == found.targets
    assert again.options.targets is None
    np.testing.assert_array_equal(again.probe_from_image.matrix, found.probe_from_image.matrix)
    text = (tmp_path / "a.json").read_text().replace('"kind": "line"', '"kind": "plane"')
    (tmp_path / "b.json").write_text(text)
    with pytest.raises(sc.FormatError, match=r"targets.thread has numbers of shapes"):
        sc.load(tmp_path / "b.json")


def test_known_rows_stand_beside_unknown_ones():
    thread, cross = sweep("line", 30, 8, Noise()), sweep("point", 30, 8, Noise())
    mover = thread.truth @ np.linalg.inv(cross.truth)
    from dataclasses import replace

    cross = replace(cross, poses=mover @ cross.poses)
    table = both(unplaced_table(thread), placed_table(cross))
    found = sc.calibrate(table, targets=[unknown("line")])
    assert list(found.targets) == ["thread"]
    assert rms_mm(found, thread) < 1
    assert found.inlier.mean() > 0.95
    rows = placed_by(found, table)
    assert set(rows.spans) == {1, 2}
    # Where both are known by the file, as well.
    both_posed = both(unplaced_table(thread), placed_table(cross))
    again = sc.calibrate(both_posed, targets=[unknown("line"), Point("cross", "Tracker", cross.place[0])])
    np.testing.assert_allclose(again.probe_from_image.matrix, found.probe_from_image.matrix, atol=1e-9)


def test_known_planes_and_lines_in_the_probes_frame_are_brought_home():
    for kind in KINDS:
        scene = sweep(kind, 30, 2)
        thread = sweep("line", 14, 2)
        from dataclasses import replace

        mover = thread.truth @ np.linalg.inv(scene.truth)
        table = both(unplaced_table(thread), placed_table(replace(scene, poses=mover @ scene.poses)))
        found = sc.calibrate(table, targets=[unknown("line")])
        assert rms_mm(found, thread) < 1e-5


def test_held_out_rows_are_measured_against_the_place_that_was_found():
    scene = sweep("line", 80, 6, Noise())
    split = np.where(scene.frame % 4 == 0, "test", "fit")
    found = sc.calibrate(unplaced_table(scene, split=split), targets=[unknown("line")], test_split="test")
    assert found.test is not None
    assert found.test.observations == 20
    assert found.test.rms_mm < 2 * found.fit.rms_mm


def test_a_lag_is_told_with_its_interval():
    scene, time_s = tank_sweep("point", 3, lag_s=0.08, frames=150, noise=Noise())
    table = unplaced_table(scene, extra={"time_s": time_s.astype(np.str_)})
    found = sc.calibrate(table, targets=[unknown("point")], latency="estimate")
    low, high = found.latency_interval_s
    assert low < found.latency_s < high
    assert abs(found.latency_s - 0.08) < 0.004
    assert rms_mm(found, scene) < 1
    from sonocal.calibration.mixed import target_distances

    rows = placed_by(found, table)
    np.testing.assert_allclose(target_distances(found.probe_from_image, rows), found.residuals_mm, atol=1e-9)


def test_a_target_that_is_not_where_it_was_said_to_be_is_told():
    scene = sweep("line", 60, 4, Noise())
    along = (scene.place[1] - scene.place[0]) / np.linalg.norm(scene.place[1] - scene.place[0])
    aside = np.cross(along, [0, 0, 1.0])
    shifted = Unplaced("line", "thread", "Tracker", scene.place + 10 * aside, 2.0, 1.0)
    found = sc.calibrate(unplaced_table(scene), targets=[shifted])
    (told,) = [one for one in found.diagnostics if one.code == "target-elsewhere"]
    assert "'thread' was found 9." in told.message or "'thread' was found 10." in told.message
    assert "from where it was said to be" in target_in_words("thread", found.targets["thread"])
    right = Unplaced("line", "thread", "Tracker", scene.place + 0.5 * aside, 2.0, 1.0)
    found = sc.calibrate(unplaced_table(scene), targets=[right])
    assert not [one for one in found.diagnostics if one.code == "target-elsewhere"]
    assert found.targets["thread"].said_off_mm < 2


@pytest.mark.parametrize("motion", ["translation", "about one axis"])
def test_a_motion_that_is_missing_is_refused_with_the_tables_name(motion):
    table = unplaced_table(sweep("line", 40, 1, Noise(), motion=motion), source="tank.csv")
    with pytest.raises(
        DegenerateGeometryError, match=r"^tank.csv: the target's place is not known, and the probe"
    ) as refused:
        sc.calibrate(table, targets=[unknown("line")])
    assert refused.value.code == f"unplaced-{motion.removeprefix('about ').replace(' ', '-')}"


def test_what_cannot_be_is_refused_in_a_sentence():
    scene = sweep("line", 20, 1)
    table = unplaced_table(scene, source="tank.csv")
    thread = [unknown("line")]
    placed = placed_table(scene, "thread")
    for rows, options, kind, said in [
        (
            table,
            {},
            InputError,
            "tank.csv, row 0: target 'thread' is given by its pose alone; say in a file of targets",
        ),
        (table, {"targets": [unknown("line", "wire")]}, InputError, "'thread' is none of the targets wire"),
        (placed, {"targets": thread}, InputError, "says in every row where its target is"),
        (
            table,
            {"targets": thread, "scale_mm_per_px": 0.2},
            UnsupportedError,
            "not found with a known scale",
        ),
        (table, {"targets": thread, "weighting": "geometric"}, UnsupportedError, "weighting geometric"),
        (table, {"targets": thread, "latency": "estimate"}, InputError, "has no column time_s"),
        (table, {"targets": ["thread"]}, InputError, "targets must be points, lines and planes"),
        (table, {"targets": "thread.toml"}, InputError, "targets must be points, lines and planes"),
        (table, {"targets": thread * 2}, InputError, "two targets are called 'thread'"),
    ]:
        with pytest.raises(kind) as refused:
            sc.calibrate(rows, **options)
        assert said in str(refused.value)


def test_a_row_without_a_name_is_of_the_only_target():
    scene = sweep("plane", 30, 1)
    found = sc.calibrate(unplaced_table(scene, ""), targets=[unknown("plane", "floor")])
    assert list(found.targets) == ["floor"]
    assert set(placed_by(found, unplaced_table(scene, "")).spans) == {3}


def test_a_known_line_whose_frame_moves_is_taken_with_its_pose():
    scene, other = sweep("line", 30, 9, Noise(), tracked=True), sweep("line", 30, 9, Noise(), tracked=True)
    table = unplaced_table(scene)
    needle = Line("thread", "Needle", scene.place)
    known = sc.calibrate(table, targets=[needle])
    assert known.targets == {}
    assert rms_mm(known, other) < 1


@given(seed=few_seeds)
@settings(max_examples=5)
def test_the_stated_region_of_a_place_is_of_its_size(seed):
    scene = sweep("point", 60, seed, Noise())
    found = sc.calibrate(unplaced_table(scene), targets=[unknown("point")])
    target = found.targets["thread"]
    assert np.linalg.norm(target.middle_mm - scene.place[0]) < 6 * target.sigma_mm
    assert target.sigma_deg == 0
