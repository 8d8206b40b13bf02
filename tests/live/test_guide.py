"""The pose that is asked for while one scans: it stays until it was held."""

import numpy as np
import pytest

from sonocal.live import Guide, State
from sonocal.recording import Item
from sonocal.simulation.sweep import NEEDLE
from sonocal.sweep import Hold, Reach, Session
from tests.builders.live import played, swept


def items_of(recording):
    for i in range(len(recording)):
        poses = {
            (one.source, one.target): one.matrices[i] if one.valid[i] else None
            for one in recording.poses.values()
        }
        yield Item(float(recording.times[i]), poses, recording.frames[i])


@pytest.fixture(scope="module")
def scanned():
    session = Session([NEEDLE])
    for item in items_of(swept(60)):
        session.add(item)
    session.fit()
    yield session
    session.close()


def test_before_there_is_a_calibration_the_first_poses_are_asked_for():
    session = Session([NEEDLE])
    guide = Guide(session)
    assert isinstance(guide(None, State()), str)
    for item in list(items_of(swept(3))):
        session.add(item)
    hold = guide(None, State(looked=3))
    assert isinstance(hold, Hold)
    assert hold.scale_mm_per_px is None
    session.close()


def test_a_pose_is_asked_for_until_it_was_held(scanned):
    guide = Guide(scanned, Reach(most_tilt_deg=30.0))
    first = guide(scanned.latest, State())
    assert first.tilt_deg <= 30.0
    assert scanned.mask[tuple(np.array(first.place_px[::-1]).round().astype(int))]
    assert guide(scanned.latest, State()) is first
    transform = scanned.latest.calibration.probe_from_image
    along = 100 * transform.rotation @ first.direction
    ends = transform @ np.array([first.place_px]) + np.array([[-0.5], [1.0]]) * along
    scanned.stream.add(held_at(scanned, ends))
    assert guide(scanned.latest, State()) is not first


def held_at(session, ends):
    """An item whose needle has its ends there."""
    z = (ends[0] - ends[1]) / np.linalg.norm(ends[0] - ends[1])
    turn, _ = np.linalg.qr(np.column_stack([z, np.eye(3)[np.argsort(abs(z))[:2]].T]))
    pose = np.eye(4)
    pose[:3, 2] = z
    pose[:3, 0] = turn[:, 1]
    pose[:3, 1] = np.cross(z, turn[:, 1])
    pose[:3, 3] = ends[0]
    last = session.stream.recording()
    poses = {("Probe", "Tracker"): np.eye(4), ("Needle", "Tracker"): pose}
    return Item(float(last.times[-1]) + 0.1, poses)


def test_a_pose_that_cannot_be_held_gives_way(scanned, monkeypatch):
    guide = Guide(scanned)
    first = guide(scanned.latest, State())
    monkeypatch.setattr("sonocal.live.guide.PATIENCE_S", -1.0)
    assert guide(scanned.latest, State()).place_px != first.place_px


def test_the_state_of_a_live_calibration_has_the_pose(tmp_path):
    moments = []

    def advice(found, state):
        moments.append(found)
        return Hold((10.0, 20.0), 30.0, 0.0, 1, (500, 500), 0.2)

    _, state = played(swept(60), tmp_path, advice=advice)
    assert moments
    assert state.hold.tilt_deg == 30.0
    assert state.advice == state.hold.words
