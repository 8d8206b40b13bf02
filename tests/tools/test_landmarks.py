"""A phantom put in place by touching its landmarks: found whatever the order, and refused where nothing tells it."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.landmarks import covered, is_right, one, registered
from benchmarks.simulators.landmark_session import BOX, EIGHT, TIP, session
from scipy.spatial.transform import Rotation

from sonocal import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.geometry import Similarity
from sonocal.recording import Poses, Recording
from sonocal.recording.formats import read_recording
from sonocal.registration.uncertainty import point_covariance
from sonocal.targets import Point, read_device_set
from sonocal.tools import Stylus, register_landmarks
from sonocal.tools.rests import find_rests

DATA = Path(__file__).parents[3] / "shared" / "data"
QUICK = {"seconds": (1.5, 3.0)}


def session_of(seed, landmarks=EIGHT, **options):
    times, poses, truth, order = session(np.random.default_rng(seed), landmarks, **QUICK, **options)
    return times, poses, truth, order


@pytest.mark.parametrize("seed", range(3))
def test_touches_in_any_order_put_the_phantom_in_place(seed):
    found, truth, order = one(seed, **QUICK)
    assert is_right(found, truth, EIGHT)
    six, ends = covered(found, truth)
    assert six.sum() >= 5
    assert ends.all()
    # Every touch that was found is the landmark that was touched then, by the order in time.
    touched = [k for k in order if k >= 0]
    at = {k: found.landmarks[k].frames[0][0] for k in touched if found.landmarks[k].frames}
    assert sorted(at, key=at.get) == [k for k in touched if k in at]
    assert len(at) >= 7
    assert "rests-elsewhere" in [finding.code for finding in found.diagnostics]


def test_moving_the_phantom_moves_its_place_with_it():
    times, poses, _, _ = session_of(1)
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = Rotation.from_rotvec([0.3, -1.2, 0.4]).as_matrix(), [30, -400, 900]
    here, there = registered(times, poses, EIGHT), registered(times, motion @ poses, EIGHT)
    np.testing.assert_allclose(there.reference_from_phantom, motion @ here.reference_from_phantom, atol=1e-6)
    np.testing.assert_allclose(
        there.target_errors[0].within_95_mm, here.target_errors[0].within_95_mm, rtol=1e-6
    )


def test_errors_of_targets_are_those_of_fitzpatrick():
    """For landmarks of one noise: FLE^2 / N (1 + sum of d_k^2 / f_k^2 / 3), by the principal axes of the landmarks."""
    found, _, _ = one(2, order=range(8), tremor_mm=0.0, seat_mm=0.4, tracker_mm=0.01, lost=0.0, **QUICK)
    used = np.array([x.at_mm for x in found.landmarks if x.used])
    middle = used - used.mean(axis=0)
    axes = np.linalg.svd(middle, full_matrices=False)[2]
    target = np.array([[30.0, 10.0, -60.0]])
    along = (target - used.mean(axis=0)) @ axes.T
    terms = [
        (np.sum(along**2) - along[0, k] ** 2) / np.mean(np.sum(middle**2, axis=1) - (middle @ axes[k]) ** 2)
        for k in range(3)
    ]
    fle2 = 3 * found.rms_mm**2 * len(used) / found.freedom
    expected = fle2 / len(used) * (1 + np.sum(terms) / 3)
    motion = Similarity.from_matrix(found.reference_from_phantom)
    variance = np.trace(point_covariance(motion, found.covariance, target)[0])
    assert variance == pytest.approx(expected, rel=0.05)


def test_a_box_tells_no_order_unless_it_is_the_one_listed():
    times, poses, truth, _ = session_of(3, BOX, order=(3, 6, 0, 5, 2, 7, 1, 4))
    with pytest.raises(DegenerateGeometryError, match=r"fit the landmarks in .* ways") as caught:
        registered(times, poses, BOX)
    assert caught.value.code == "landmarks-ambiguous"
    times, poses, truth, _ = session_of(3, BOX, order=range(8))
    found = registered(times, poses, BOX)
    assert found.diagnostics[0].code == "landmarks-ambiguous"
    assert is_right(found, truth, BOX)
    found = registered(times, poses, BOX, in_order=True)
    assert is_right(found, truth, BOX)
    assert "landmarks-ambiguous" not in [finding.code for finding in found.diagnostics]


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda places: places * [1, 1, -1], NoConsensusError, "of the mirrored phantom"),
        (
            lambda places: places / 1000,
            InputError,
            "in metres; give the phantom in mm: multiply its places by 1000",
        ),
        (lambda places: places / 25.4, InputError, "in inches"),
        (lambda places: places[:2], InputError, "three landmarks or more, better six; got 2"),
        (lambda places: np.outer(np.arange(5), [10.0, 5.0, 2.0]), DegenerateGeometryError, "lie on one line"),
        (lambda places: places @ np.diag([1.6, 0.4, 3.0]), NoConsensusError, "landmarks fit the"),
    ],
)
def test_landmarks_that_are_wrong_are_refused_by_what_is_wrong(change, error, words):
    times, poses, _, _ = session_of(4)
    with pytest.raises(error, match=words):
        registered(times, poses, change(EIGHT))


def test_a_landmark_that_lies_off_is_left_out_and_named():
    times, poses, truth, _ = session_of(5, false=0)
    moved = EIGHT.copy()
    moved[2] += [1.5, 1.5, -1.5]
    found = registered(times, poses, moved)
    assert [x.name for x in found.landmarks if not x.used] == ["#3"]
    assert {"landmark-off", "landmarks-missing"} & {finding.code for finding in found.diagnostics}
    assert is_right(found, truth, EIGHT)


def test_a_phantom_that_shrank_is_told():
    times, poses, _, _ = session_of(6, false=0)
    found = registered(times, poses, EIGHT * 1.012)
    assert "landmark-scale" in [finding.code for finding in found.diagnostics]
    assert found.size_ratio == pytest.approx(1 / 1.012, abs=0.004)


def test_a_wrong_tip_is_told_and_one_that_is_far_off_refused():
    times, poses, _, _ = session_of(8, false=0, tip_error_mm=3.0)
    found = registered(times, poses, EIGHT)
    (doubt,) = [finding for finding in found.diagnostics if finding.code == "stylus-tip-off"]
    assert doubt.severity == "warning"
    times, poses, _, _ = session_of(8, false=0, tip_error_mm=8.0)
    with pytest.raises(InputError, match="pivot the stylus and give that tip") as caught:
        registered(times, poses, EIGHT)
    nearer = np.array([float(x) for x in str(caught.value).split("nearer to ")[1].strip(")").split(",")])
    assert np.linalg.norm(nearer - TIP - 8 * np.array([0.6, 0, 0.8])) < 2.0


def test_a_recording_without_rest_is_refused():
    t = np.arange(200) / 20
    poses = np.tile(np.eye(4), (200, 1, 1))
    poses[:, :3, 3] = 100 * np.column_stack([np.sin(3 * t), np.cos(2.2 * t), np.sin(1.7 * t)])
    with pytest.raises(InputError, match="rested at 0 places, and 4 landmarks are needed"):
        registered(t, poses, EIGHT)


def test_frozen_poses_are_no_rest():
    """A tracker that repeats itself while the stylus moves is no touch."""
    _, poses, _, _ = session_of(7, order=range(8), false=0, lost=0.0)
    pose = Poses.of("Stylus", "Reference", np.repeat(poses[:1] * 1.0, 60, axis=0))
    stalled = Recording(np.arange(60) / 20, poses={pose.name: pose})
    points = [Point(str(i), "Phantom", place) for i, place in enumerate(EIGHT)]
    with pytest.raises(InputError, match="rested at 0 places"):
        register_landmarks(stalled, points, Stylus("Stylus", TIP))


def test_rests_are_found_where_they_are():
    rng = np.random.default_rng(0)
    t = np.arange(300) / 20
    places = np.zeros((300, 3))
    places[100:200] = [50, 0, 0]
    places[200:] = [50, 0, 0] + np.arange(100)[:, None] * [3.0, 1.0, 0.0]
    first, second = find_rests(places + rng.normal(0, 0.2, places.shape), t)
    # Half a second at each end is given up: an approach must not count.
    assert 89 <= first.last <= 99
    assert 100 <= second.first <= 110
    np.testing.assert_allclose(second.point_mm, [50, 0, 0], atol=0.2)


def test_a_real_session_agrees_with_plus(data_folder):
    recordings = data_folder / "recordings"
    devices = read_device_set(recordings / "PlusDeviceSet_fCal_Sim_RecordPhantomLandmarks.xml")
    plus = read_device_set(recordings / "PhantomRegistrationLandmarkDetection.results.xml")
    expected = plus.transforms["Reference", "Phantom"]
    session_file = recordings / "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha"
    stylus = Stylus("Stylus", devices.transforms["Stylus", "StylusTip"][:3, 3])
    found = register_landmarks(read_recording(session_file), devices.landmarks, stylus, targets=devices.wires)
    assert found.as_listed
    assert all(x.used for x in found.landmarks)
    assert np.linalg.norm(found.reference_from_phantom[:3, 3] - expected[:3, 3]) < 0.3
    turn = Rotation.from_matrix(found.reference_from_phantom[:3, :3] @ expected[:3, :3].T).magnitude()
    assert np.degrees(turn) < 0.3
    # The stylus is turned during the touches, and its tip moves; PLUS takes their first second: 0.198 mm.
    assert found.mean_mm < 0.4
    assert [finding.code for finding in found.diagnostics] == ["rests-elsewhere"]
