"""Recordings in whose images points of beads, threads and floors were found."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.detection import Detections
from sonocal.errors import InputError
from sonocal.recording import Poses, Recording
from sonocal.sweep import calibrate_points
from sonocal.targets import Line, Plane, Point

FRAMES = 60
BEADS = {f"bead {i}": np.array([20.0 * i, 5.0 * (-1) ** i, 3.0 * i]) for i in range(3)}
THREAD = np.array([[-40.0, 10.0, 20.0], [60.0, -15.0, 35.0]])
FLOORS = {
    "floor": np.array([[0.0, 0, 40], [100, 0, 40], [0, 100, 42]]),
    "wall": np.array([[-60.0, 0, 0], [-60, 100, 0], [-58, 0, 100]]),
}
TARGETS = [
    Line("thread", "Tracker", THREAD),
    *(Point(name, "Tracker", place) for name, place in BEADS.items()),
    *(Plane(name, "Tracker", points) for name, points in FLOORS.items()),
]


def scanned(seed=1, noise=0.3):
    """A probe that is held so that its image meets one target after the other; and what the images show."""
    random = np.random.default_rng(seed)
    truth = sc.Similarity(Rotation.random(rng=random).as_matrix(), random.uniform(-50, 50, 3), 0.2)
    poses, frames, points, names = [], [], [], []
    for frame in range(FRAMES):
        target = TARGETS[frame % len(TARGETS)]
        turn = Rotation.random(rng=random).as_matrix()
        spanning = target.spanning_mm
        shares = random.dirichlet(np.ones(len(spanning)))
        at = random.uniform(50, 450, 2)
        seen = [at]
        # tracker_from_probe such that the image's point lies on the target
        place = shares @ spanning - turn @ (truth @ np.r_[at, 0.0][None])[0]
        if isinstance(target, Plane):  # another point of the image in the plane
            normal = np.cross(spanning[1] - spanning[0], spanning[2] - spanning[0])
            across = (normal @ turn) @ truth.rotation[:, :2]
            along = np.array([-across[1], across[0]]) / np.linalg.norm(across)
            seen.append(at + 150 * along)
        poses.append(np.block([[turn, place[:, None]], [np.zeros((1, 3)), 1]]))
        for one in seen:
            frames.append(frame)
            points.append(one + noise * random.normal(size=2))
            names.append(target.name)
    times = np.arange(FRAMES) / 10.0
    recording = Recording(
        times=times, poses={"ProbeToTracker": Poses.of("Probe", "Tracker", np.array(poses))}
    )
    return truth, recording, Detections.of_points(frames, points, target=names)


def test_beads_threads_and_floors_calibrate_a_probe():
    truth, recording, found = scanned()
    calibration, table = calibrate_points(recording, TARGETS, found)
    assert set(table.spans.tolist()) == {1, 2, 3}
    corners = np.array([[0.0, 0, 0], [500, 0, 0], [0, 500, 0], [500, 500, 0]])
    off = np.linalg.norm(calibration.probe_from_image @ corners - truth @ corners, axis=1)
    assert np.all(off < 2 * calibration.predicted_errors()[2][:-1].max())
    assert off.max() < 0.5
    assert calibration.fit.inliers == len(found)


def test_what_is_seen_in_frames_without_a_pose_is_left_out_and_said():
    _, recording, found = scanned()
    poses = recording.poses["ProbeToTracker"]
    valid = np.arange(FRAMES) >= 5
    lost = Poses("Probe", "Tracker", poses.matrices, valid, ("OK",) * FRAMES)
    calibration, table = calibrate_points(
        Recording(times=recording.times, poses={lost.name: lost}), TARGETS, found
    )
    assert table.frame.min() == 5
    assert "no-pose" in [one.code for one in calibration.warnings]


def test_points_of_lines_alone_are_calibrated_as_ever_whatever_else_the_file_holds():
    random = np.random.default_rng(3)
    needle = Line("needle", "Tracker", THREAD)
    _, recording, _ = scanned()
    found = Detections.of_points(np.arange(FRAMES), random.uniform(0, 500, (FRAMES, 2)))
    tip = Point("tip", "Tracker", THREAD[0])
    messages = []
    for lines in ([needle], [needle, tip]):
        with pytest.raises(sc.SonocalError) as refusal:
            calibrate_points(recording, lines, found)
        messages.append(str(refusal.value))
    assert messages[0] == messages[1]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            {"target": ["roof", "wall", "floor"]},
            "target 'roof' is none of the targets thread, bead 0, bead 1",
        ),
        ({"target": [""] * 3}, "target '' is none of the targets"),
        ({"frame": [0, 1, FRAMES]}, "point 2: frame 60 is not in .* frames 0 to 59"),
    ],
)
def test_points_that_belong_nowhere_are_refused(change, says):
    _, recording, _ = scanned()
    given = {"frame": [0, 1, 2], "target": ["floor"] * 3} | change
    found = Detections.of_points(given["frame"], np.eye(3)[:, :2] * 100, target=given["target"])
    targets = TARGETS if "" not in given["target"] else [one for one in TARGETS if not isinstance(one, Line)]
    with pytest.raises(InputError, match=says):
        calibrate_points(recording, targets, found)
