from dataclasses import replace

import numpy as np
import pytest

from sonocal import InputError, read_observations
from sonocal.detection import Detections, read_detections
from sonocal.recording import (
    Poses,
    Recording,
    with_latency,
)
from sonocal.recording.formats import read_recording
from sonocal.sweep import Posing, tabulate
from sonocal.targets import (
    Line,
    read_lines,
)
from tests.builders.recordings import random_poses

NEEDLE = Line("needle", "Needle", np.array([[0.0, 0, 0], [0, 0, -100]]))


def recording_of(n=10, seed=0):
    rng = np.random.default_rng(seed)
    poses = [Poses.of(tool, "Tracker", random_poses(rng, n)) for tool in ("Probe", "Needle")]
    return Recording(times=np.arange(n) * 0.1, poses={p.name: p for p in poses})


def detections_of(frames, target="needle"):
    n = len(frames)
    points = np.random.default_rng(1).uniform(0, 500, (n, 2))
    return Detections.of_points(frames, points, target)


def test_wires_of_a_real_recording_are_where_plus_puts_them(data_folder):
    folder = data_folder / "recordings"
    expected = read_observations(data_folder / "observations" / "fcal12_ascension.csv")
    lines, fixed = read_lines(folder / "PlusDeviceSet_fCal_Sim_SpatialCalibration_1.2.xml")
    for split in ("Calibration", "Validation"):
        table = expected.select_split(split.lower())
        recording = read_recording(folder / f"fCal_Test_{split}_3NWires.igs.mha")
        detections = Detections.of_points(table.frame, table.points_px, table.target)
        found = tabulate(recording, lines, detections, Posing(fixed=fixed))
        np.testing.assert_allclose(found.observations.segments_mm, table.segments_mm, atol=1e-3)
        assert found.kept.all()


def test_moving_the_tracker_changes_nothing():
    recording, other = recording_of(), random_poses(np.random.default_rng(9), 1)[0]
    moved = replace(
        recording,
        poses={k: Poses.of(p.source, p.target, other @ p.matrices) for k, p in recording.poses.items()},
    )
    tables = [tabulate(r, [NEEDLE], detections_of(range(10))).observations for r in (recording, moved)]
    np.testing.assert_allclose(tables[0].segments_mm, tables[1].segments_mm, atol=1e-9)


def test_a_line_on_the_probe_needs_no_pose():
    line = Line("wire", "Probe", np.array([[1.0, 2, 3], [4, 5, 6]]))
    found = tabulate(recording_of(), [line], detections_of([0, 3], "wire"))
    np.testing.assert_array_equal(found.observations.segments_mm, [line.segment_mm] * 2)


def test_frames_without_a_pose_are_left_out_and_reported():
    recording = recording_of()
    needle = recording.poses["tracker_from_needle"]
    lost = Poses("Needle", "Tracker", needle.matrices, np.arange(10) != 4)
    recording = replace(recording, poses={**recording.poses, "tracker_from_needle": lost})
    found = tabulate(recording, [NEEDLE], detections_of(range(10)))
    assert found.observations.frame.tolist() == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    (diagnostic,) = found.diagnostics
    assert (diagnostic.code, diagnostic.message) == (
        "no-pose",
        "1 of 10 detections have no valid pose and were left out",
    )


def test_latency_takes_later_poses():
    n = 10
    needle = np.tile(np.eye(4), (n, 1, 1))
    needle[:, 0, 3] = np.arange(n)
    poses = [
        Poses.of("Probe", "Tracker", np.tile(np.eye(4), (n, 1, 1))),
        Poses.of("Needle", "Tracker", needle),
    ]
    recording = Recording(times=np.arange(n) * 0.1, poses={p.name: p for p in poses})
    found = tabulate(with_latency(recording, 0.15), [NEEDLE], detections_of(range(8)))
    np.testing.assert_allclose(found.observations.segments_mm[:, 0, 0], np.arange(8) + 1.5)


def test_what_does_not_fit_is_refused():
    recording = recording_of()
    with pytest.raises(InputError) as caught:
        tabulate(recording, [NEEDLE], detections_of([3, 10]))
    assert str(caught.value) == "detections, point 1: frame 10 is not in recording, which has frames 0 to 9"
    with pytest.raises(InputError, match="target 'wire' is none of the lines needle; name one"):
        tabulate(recording, [NEEDLE], detections_of([3], "wire"))
    with pytest.raises(InputError, match="nothing connects Stylus to Probe"):
        tabulate(recording, [replace(NEEDLE, frame="Stylus")], detections_of([3]))


def test_points_are_read_from_a_table(tmp_path):
    (tmp_path / "p.csv").write_text("frame,u_px,v_px,sigma_px\n0,10.5,20,0.5\n7,1,2,0.5\n")
    found = read_detections(tmp_path / "p.csv")
    assert found.frame.tolist() == [0, 7]
    assert found.points_px.tolist() == [[[10.5, 20]], [[1, 2]]]
    assert found.target.tolist() == ["", ""]
    table = tabulate(recording_of(), [NEEDLE], found).observations
    assert table.target.tolist() == ["needle", "needle"]
    (tmp_path / "p.csv").write_text("frame,u_px\n0,1\n")
    with pytest.raises(InputError) as caught:
        read_detections(tmp_path / "p.csv")
    assert str(caught.value) == (
        "p.csv, line 1: lacks the column v_px; "
        "a table of points has frame, u_px, v_px and perhaps w_px, target, sigma_px"
    )
