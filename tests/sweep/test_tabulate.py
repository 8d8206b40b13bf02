"""The table of sightings from a recording: what it must not depend on, and what it must follow."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError, Line, read_observations
from sonocal.detection import Detections, read_detections
from sonocal.geometry import predicted_needles, predicted_points
from sonocal.recording import Poses, Recording, with_latency
from sonocal.recording.formats import read_recording
from sonocal.sweep import Posing, tabulate
from sonocal.targets import read_lines
from tests.builders.recordings import random_poses
from tests.builders.sweeps import NEEDLE, scan_of, with_marker_moved, with_tracker_moved

seeds = st.integers(0, 5_000)
dimensions = st.sampled_from([2, 3])
OTHER = Line("other", "Needle", np.array([[30.0, 0.0, 0.0], [30.0, 5.0, -200.0]]))
COLUMNS = ("points_px", "segments_mm", "frame", "target", "split", "sigma_px")


def table_of(scan, **changes):
    scan = replace(scan, **changes)
    return tabulate(scan.recording, scan.lines, scan.detections).observations


def assert_same_rows(found, expected, atol=0.0):
    for name in COLUMNS:
        one, other = getattr(found, name), getattr(expected, name)
        if name == "segments_mm":
            np.testing.assert_allclose(one, other, atol=atol, rtol=0)
        else:
            np.testing.assert_array_equal(one, other)


def rows_of(detections, chosen):
    """The rows of some detections, given by indices, where each is tried against one line."""
    each = detections.points_each
    return (np.asarray(chosen)[:, None] * each + np.arange(each)).reshape(-1)


@given(seeds, dimensions)
def test_a_noise_free_needle_is_seen_where_the_truth_puts_it(seed, dimension):
    scan = scan_of(dimension, 12, seed, sigma_px=0, sigma_mm=0)
    rows = table_of(scan)
    if dimension == 2:
        np.testing.assert_allclose(
            predicted_points(scan.probe_from_image, rows.segments_mm), rows.points_px, atol=1e-6
        )
        return
    first, second = np.moveaxis(predicted_needles(scan.probe_from_image, rows.segments_mm), 1, 0)
    off = np.cross(rows.points_px - first, (second - first) / np.linalg.norm(second - first, axis=1)[:, None])
    np.testing.assert_allclose(off, 0, atol=1e-6)


@given(seeds, dimensions)
def test_detections_in_another_order_are_the_same_rows_in_that_order(seed, dimension):
    scan = scan_of(dimension, 15, seed, decoys=2)
    order = np.random.default_rng(seed).permutation(len(scan.detections))
    found = table_of(scan, detections=scan.detections.select(order))
    assert_same_rows(found, table_of(scan).select(rows_of(scan.detections, order)))


@given(seeds, dimensions)
def test_some_of_the_detections_are_some_of_the_rows(seed, dimension):
    scan = scan_of(dimension, 15, seed, decoys=1)
    some = np.flatnonzero(np.random.default_rng(seed).random(len(scan.detections)) < 0.5)
    if len(some):
        found = table_of(scan, detections=scan.detections.select(some))
        assert_same_rows(found, table_of(scan).select(rows_of(scan.detections, some)))


@given(seeds, dimensions)
def test_where_the_tracker_stands_has_no_say(seed, dimension):
    scan = scan_of(dimension, 10, seed)
    elsewhere = random_poses(np.random.default_rng(seed), 1)[0]
    moved = with_tracker_moved(scan.recording, elsewhere)
    assert_same_rows(table_of(scan, recording=moved), table_of(scan), atol=1e-9)


@given(seeds, dimensions)
def test_moving_the_probe_s_marker_moves_the_needles_with_it(seed, dimension):
    scan = scan_of(dimension, 10, seed)
    probe_from_marker = random_poses(np.random.default_rng(seed), 1)[0]
    moved = with_marker_moved(scan.recording, "Probe", probe_from_marker)
    found, expected = table_of(scan, recording=moved), table_of(scan)
    back = found.segments_mm @ probe_from_marker[:3, :3].T + probe_from_marker[:3, 3]
    assert_same_rows(found.with_sound(segments_mm=back), expected, atol=1e-9)


@given(seeds, dimensions)
def test_a_needle_told_in_its_moved_marker_s_frame_is_the_same_needle(seed, dimension):
    scan = scan_of(dimension, 10, seed)
    needle_from_marker = random_poses(np.random.default_rng(seed), 1)[0]
    moved = with_marker_moved(scan.recording, "Needle", needle_from_marker)
    ends = (NEEDLE.segment_mm - needle_from_marker[:3, 3]) @ needle_from_marker[:3, :3]
    found = table_of(scan, recording=moved, lines=(replace(NEEDLE, segment_mm=ends),))
    assert_same_rows(found, table_of(scan), atol=1e-9)


@given(seeds, dimensions)
def test_a_fixed_transform_is_a_pose_that_never_changes(seed, dimension):
    """Of a table's stand: the needle known in it, and it in the tracker's frame."""
    scan, rng = scan_of(dimension, 10, seed), np.random.default_rng(seed)
    stand = random_poses(rng, 1)[0]
    poses = {**scan.recording.poses}
    poses["tracker_from_stand"] = Poses.of("Stand", "Tracker", np.tile(stand, (10, 1, 1)))
    on_stand = (replace(NEEDLE, frame="Stand"),)
    tracked = replace(scan.recording, poses=poses)
    told = tabulate(scan.recording, on_stand, scan.detections, Posing(fixed={("Tracker", "Stand"): stand}))
    assert_same_rows(told.observations, table_of(scan, recording=tracked, lines=on_stand), atol=1e-9)


@given(seeds, dimensions)
def test_any_line_is_every_line_by_name(seed, dimension):
    scan = scan_of(dimension, 10, seed, decoys=1)
    lines, found = (NEEDLE, OTHER), scan.detections
    any_line = tabulate(scan.recording, lines, found).observations
    assert len(any_line) == 2 * found.points_each * len(found)
    assert (np.diff(any_line.frame) >= 0).all()
    for line in lines:
        named = replace(found, target=np.full(len(found), line.name))
        expected = tabulate(scan.recording, lines, named).observations
        assert_same_rows(any_line.select(any_line.target == line.name), expected)


@given(seeds, dimensions, st.floats(0.1, 0.9))
def test_what_is_left_out_is_told_and_the_rest_stays(seed, dimension, share):
    scan, rng = scan_of(dimension, 20, seed, decoys=1), np.random.default_rng(seed)
    posed, seen = rng.random(20) > share / 2, rng.random(20) > share / 2
    posed[0] = seen[0] = True
    needle = scan.recording.poses["tracker_from_needle"]
    lost = replace(needle, valid=posed)
    recording = replace(scan.recording, poses={**scan.recording.poses, needle.name: lost}, image_valid=seen)
    found = tabulate(recording, scan.lines, scan.detections)
    frame = scan.detections.frame
    np.testing.assert_array_equal(found.kept, posed[frame] & seen[frame])
    kept = rows_of(scan.detections, np.flatnonzero(found.kept))
    assert_same_rows(found.observations, table_of(scan).select(kept))
    told = {one.code: int(one.message.split()[0]) for one in found.diagnostics}
    expected = {"no-pose": int((~posed[frame]).sum()), "no-image": int((posed & ~seen)[frame].sum())}
    assert told == {code: count for code, count in expected.items() if count}


@given(seeds, st.floats(-0.15, 0.15))
def test_a_latency_undone_is_none(seed, latency_s):
    """A tracker whose stamps are late, and what is seen at the stamps that images have."""
    rng = np.random.default_rng(seed)
    times = np.arange(12) * 0.1
    poses = [steady(tool, times, rng) for tool in ("Probe", "Needle")]
    late = [steady_at(one, times - latency_s, times) for one in poses]
    found = Detections.of_points(np.arange(2, 10), rng.uniform(0, 500, (8, 2)))
    tables = [
        tabulate(recording, (NEEDLE,), found).observations
        for recording in (
            Recording(times, poses={one.name: one for one in poses}),
            with_latency(Recording(times, poses={one.name: one for one in late}), latency_s),
        )
    ]
    assert_same_rows(tables[1].with_sound(sigma_px=None), tables[0].with_sound(sigma_px=None), atol=1e-7)


def steady(tool, times, rng):
    """Poses that move evenly, so that what lies between two of them is known."""
    matrices = np.tile(random_poses(rng, 1)[0], (len(times), 1, 1))
    matrices[:, :3, 3] += times[:, None] * rng.normal(scale=50, size=3)
    return Poses.of(tool, "Tracker", matrices)


def steady_at(poses, at, times):
    """The same motion at other times, beyond the ends too."""
    matrices = poses.matrices.copy()
    speed = (matrices[-1, :3, 3] - matrices[0, :3, 3]) / (times[-1] - times[0])
    matrices[:, :3, 3] = matrices[0, :3, 3] + (at - times[0])[:, None] * speed
    return Poses.of(poses.source, poses.target, matrices)


def test_a_line_on_the_probe_needs_no_pose():
    line = Line("wire", "Probe", np.array([[1.0, 2, 3], [4, 5, 6]]))
    found = tabulate(scan_of(frames=False).recording, [line], Detections.of_points([0, 3], [[1, 2], [3, 4]]))
    np.testing.assert_array_equal(found.observations.segments_mm, [line.segment_mm] * 2)


def test_a_volume_s_lines_are_told_apart_by_their_rank():
    scan = scan_of(3, 4, decoys=2)
    rows = table_of(scan)
    assert rows.split.tolist() == np.repeat(scan.detections.rank, 2).astype(str).tolist()
    assert len(np.unique(rows.sightings)) == len(scan.detections)


@pytest.mark.parametrize("name", ["Calibration", "Validation"])
def test_wires_of_a_real_recording_are_where_plus_puts_them(data_folder, name):
    folder = data_folder / "recordings"
    expected = read_observations(data_folder / "observations" / "fcal12_ascension.csv")
    lines, fixed = read_lines(folder / "PlusDeviceSet_fCal_Sim_SpatialCalibration_1.2.xml")
    table = expected.select_split(name.lower())
    recording = read_recording(folder / f"fCal_Test_{name}_3NWires.igs.mha")
    detections = Detections.of_points(table.frame, table.points_px, table.target)
    found = tabulate(recording, lines, detections, Posing(fixed=fixed))
    np.testing.assert_allclose(found.observations.segments_mm, table.segments_mm, atol=1e-3)
    assert found.kept.all()


def test_points_of_a_file_belong_to_the_only_line_there_is(tmp_path):
    (tmp_path / "p.csv").write_text("frame,u_px,v_px,sigma_px\n0,10.5,20,0.5\n7,1,2,0.5\n")
    found = read_detections(tmp_path / "p.csv")
    assert found.frame.tolist() == [0, 7]
    assert found.points_px.tolist() == [[[10.5, 20]], [[1, 2]]]
    table = tabulate(scan_of(2).recording, [NEEDLE], found).observations
    assert table.target.tolist() == ["needle", "needle"]
    assert table.sigma_px.tolist() == [0.5, 0.5]
    assert table.source == "p.csv"
    (tmp_path / "p.csv").write_text("frame,u_px\n0,1\n")
    with pytest.raises(InputError) as caught:
        read_detections(tmp_path / "p.csv")
    assert str(caught.value) == (
        "p.csv, line 1: lacks the column v_px; "
        "a table of points has frame, u_px, v_px and perhaps w_px, target, sigma_px"
    )


FOUND = Detections.of_points([3, 10], [[1, 2], [3, 4]])


@pytest.mark.parametrize(
    ("lines", "found", "sentence"),
    [
        (
            [NEEDLE],
            FOUND,
            "detections, point 1: frame 10 is not in recording, which has frames 0 to 9",
        ),
        (
            [NEEDLE],
            replace(FOUND, target=["needle", "wire"]),
            "detections: target 'wire' is none of the lines needle; name one",
        ),
        (
            [replace(NEEDLE, frame="Stylus")],
            FOUND.select([0]),
            "recording: nothing connects Stylus to Probe; the transforms are ProbeToTracker, NeedleToTracker",
        ),
        ([], FOUND.select([0]), "recording: there is no line to look for; give the needle or the wires"),
        (
            [NEEDLE, NEEDLE],
            FOUND.select([0]),
            "recording: two lines are called 'needle'; give each its own name",
        ),
        (
            [NEEDLE],
            Detections([0], [[[1.0, 2, 3], [4, 5, 6]]]),
            "detections: holds points of 3 coordinates where recording has 2D images; "
            "give places in the images of this recording",
        ),
    ],
    ids=["frame", "target", "frame of a line", "no line", "two lines of one name", "dimension"],
)
def test_what_does_not_fit_is_refused(lines, found, sentence):
    with pytest.raises(InputError) as caught:
        tabulate(scan_of(2, 10).recording, lines, found)
    assert str(caught.value) == sentence


def test_where_nothing_is_left_there_is_no_table():
    scan = scan_of(2, 10)
    blind = replace(scan.recording, image_valid=np.zeros(10, dtype=bool))
    with pytest.raises(InputError, match="none of the 10 detections of recording is in a frame with valid"):
        table_of(scan, recording=blind)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"probe": ""}, "probe must be the name of the probe's marker, such as 'Probe'; got ''"),
        ({"on_invalid": "drop"}, "on_invalid must be one of raise, skip; got 'drop'"),
        ({"fixed": [np.eye(4)]}, "fixed must map (target, source) to a 4 x 4 matrix; got list"),
        (
            {"fixed": {("Tracker", "Stand"): np.eye(3)}},
            "fixed must map (target, source) to a 4 x 4 matrix; got ('Tracker', 'Stand') to shape (3, 3)",
        ),
        (
            {"fixed": {"StandToTracker": np.eye(4)}},
            "fixed must map (target, source) to a 4 x 4 matrix; got 'StandToTracker' to shape (4, 4)",
        ),
    ],
)
def test_posing_that_means_nothing_is_refused(options, sentence):
    with pytest.raises(InputError) as caught:
        Posing(**options)
    assert str(caught.value) == sentence


def test_a_pose_that_is_not_rigid_is_refused_or_left_out():
    scan = scan_of(2, 10)
    one = scan.recording.poses["tracker_from_needle"]
    bent = one.matrices.copy()
    bent[6, :3, :3] *= 1.2
    recording = replace(scan.recording, poses={**scan.recording.poses, one.name: replace(one, matrices=bent)})
    with pytest.raises(InputError, match="recording, frame 6: NeedleToTracker is not rigid"):
        tabulate(recording, [NEEDLE], scan.detections)
    found = tabulate(recording, [NEEDLE], scan.detections, Posing(on_invalid="skip"))
    assert found.observations.frame.tolist() == [0, 1, 2, 3, 4, 5, 7, 8, 9]
