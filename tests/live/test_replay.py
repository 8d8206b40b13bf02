"""A recording is sent as PLUS would: in the version that the client speaks, with what goes wrong on demand."""

import threading

import numpy as np
import pytest

from sonocal import InputError, igtl
from sonocal.live import Faults, Replay
from tests.builders.live import LONG_S, until
from tests.builders.recordings import random_recording


@pytest.fixture(scope="module")
def recording():
    return random_recording(3, n=12, size=(20, 16))


def sent(recording, *, version, **how):
    stop, found = threading.Event(), []
    with igtl.Server() as server, igtl.Client("127.0.0.1", server.port) as client:
        assert server.wait_for_peer(LONG_S)
        client.send(igtl.Message(igtl.Text("hello"), version=version))
        until(lambda: server.peers[0].version == version)
        Replay(recording, **how).run(server, stop, rate_hz=1000)
        assert server.flush(LONG_S)
        until(lambda: client.quiet_s > 0.3)
        found += client.take(0.1)
    return found


@pytest.mark.parametrize("version", [1, 2])
def test_everything_is_sent_in_the_version_that_the_client_speaks(recording, version):
    found = sent(recording, version=version)
    assert {one.version for one in found} == {version}
    poses = [one for one in found if one.kind == "TRANSFORM"]
    assert len(poses) == sum(int(one.valid.sum()) for one in recording.poses.values())
    images = [one for one in found if one.kind == "IMAGE"]
    assert len(images) == int(recording.image_valid.sum())
    by_stamp = {one.stamp for one in images}
    assert {one.stamp for one in poses if one.stamp in by_stamp}
    if version == 2:
        assert {one.meta.get("TransformStatus") for one in poses} == {"OK"}


def test_the_same_faults_come_again_with_the_same_seed(recording):
    def devices(seed):
        played = Replay(recording, Faults(0.5, 0.2, 0.0, True, seed), begin_s=1e9)
        return [(one.name, one.stamp, one.valid) for i in range(12) for one in played.messages(i)]

    assert devices(1) == devices(1)
    assert devices(1) != devices(2)


def test_apart_no_pose_has_the_stamp_of_an_image(recording):
    played = Replay(recording, apart=True, begin_s=1e9)
    messages = [one for i in range(12) for one in played.messages(i)]
    stamps = {kind: {one.stamp for one in messages if one.kind == kind} for kind in ("IMAGE", "TRANSFORM")}
    assert stamps["TRANSFORM"]
    assert not stamps["IMAGE"] & stamps["TRANSFORM"]


@pytest.mark.parametrize("share", [-0.1, 1.0, float("nan")])
def test_a_share_that_is_none_is_refused(share):
    with pytest.raises(InputError, match="gaps must be a share"):
        Faults(gaps=share)


def test_time_goes_on_when_it_begins_again(recording):
    played = Replay(recording, begin_s=1e9)
    stamps = [played.messages(i, turn)[0].stamp for turn in range(3) for i in range(12) if played.messages(i)]
    assert (np.diff(np.array(stamps, dtype=float)) > 0).all()
