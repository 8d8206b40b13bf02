"""Messages become items: by their stamps, whatever order, clock or tracker they are of."""

import numpy as np
import pytest

from sonocal import igtl
from sonocal.live import Pairing
from tests.builders.messages import pixels, pose

START = 1_700_000_000 << 32
STEP = (1 << 32) // 20
PROBE, NEEDLE = ("Probe", "Tracker"), ("Needle", "Tracker")


def image(at):
    return igtl.Message(igtl.Image.of(pixels(shape=(20, 30))), "Image_Image", at)


def moved(x):
    matrix = np.eye(4)
    matrix[0, 3] = x
    return matrix


def tool(name, at, x=0.0, **how):
    return igtl.Message(igtl.Transform(moved(x)), f"{name}ToTracker", at, **how)


def items(messages, **how):
    pairing, found = Pairing(**how), []
    for number, message in enumerate(messages):
        pairing.add(message, number * 1e-3)
        found += pairing.items(number * 1e-3)
    return pairing, [*found, *pairing.items(1e9, ended=True)]


def xs(found, names):
    return [None if one.poses.get(names) is None else float(one.poses[names][0, 3]) for one in found]


def frame(i, *tools):
    at = START + i * STEP
    return [image(at), *(tool(name, at, i + 0.5) for name in tools)]


def test_messages_of_a_frame_share_a_stamp():
    pairing, found = items([one for i in range(9) for one in frame(i, "Probe", "Needle")])
    assert xs(found, PROBE) == xs(found, NEEDLE) == [i + 0.5 for i in range(9)]
    np.testing.assert_allclose([one.time_s for one in found], np.arange(9) / 20, atol=1e-9)
    assert (pairing.images, pairing.paired, pairing.late, pairing.apart) == (9, 9, 0, False)


def test_a_pose_is_never_used_again():
    _, found = items([one for i in range(9) for one in frame(i, "Probe", *(["Needle"] if i % 3 else []))])
    assert xs(found, NEEDLE) == [None if i % 3 == 0 else i + 0.5 for i in range(9)]


def test_what_its_sender_does_not_vouch_for_is_lost():
    lost = {"TransformStatus": "INVALID"}
    _, found = items([*frame(0, "Probe"), *frame(1), tool("Probe", START + STEP, meta=lost, version=2)])
    assert xs(found, PROBE) == [0.5, None]


@pytest.mark.parametrize("seed", range(5))
def test_frames_that_arrive_in_disorder_come_in_order(seed):
    messages = [one for i in range(30) for one in frame(i, "Probe", "Needle")]
    chance = np.random.default_rng(seed)
    place = np.argsort(np.arange(len(messages)) + chance.uniform(0, 4, len(messages)), kind="stable")
    pairing, found = items([messages[i] for i in place])
    assert xs(found, PROBE) == xs(found, NEEDLE) == [i + 0.5 for i in range(30)]
    assert pairing.late == 0


@pytest.mark.parametrize("latency_s", [0.0, 0.02, -0.015])
def test_streams_of_their_own_are_interpolated_with_the_latency(latency_s):
    """The tool moves evenly by 1 mm a second from 0: its place is the time."""
    of_tool = [tool("Probe", START + i * STEP // 3 + 7, i / 60) for i in range(90)]
    of_image = [image(START + i * STEP) for i in range(30)]
    messages = sorted([*of_tool, *of_image], key=lambda one: one.stamp)
    pairing, found = items(messages, latency_s=latency_s)
    assert pairing.apart
    inside = found[2:-2]
    want = [one.time_s + latency_s for one in inside]
    np.testing.assert_allclose(xs(inside, PROBE), want, atol=1e-6)


def test_tools_of_one_message_are_as_good_as_transforms():
    parts = [igtl.Tool("Probe", moved(3.0)), igtl.Tool("Needle", moved(4.0))]
    messages = []
    for i in range(4):
        at = START + i * STEP
        messages += [image(at), igtl.Message(igtl.Tools(tuple(parts)), "Polaris", at)]
    _, found = items(messages)
    assert xs(found, PROBE) == [3.0] * 4
    assert xs(found, NEEDLE) == [4.0] * 4


@pytest.mark.parametrize("by_s", [-3600.0, 3600.0, -1.7e9])
def test_a_clock_that_is_set_is_said_once_and_the_time_line_goes_on(by_s):
    messages = []
    for i in range(20):
        at = START + i * STEP + (int(by_s * 2**32) if i >= 10 else 0)
        messages += [image(at), tool("Probe", at, i)]
    pairing, found = items(messages)
    assert xs(found, PROBE) == [float(i) for i in range(20)]
    assert (np.diff([one.time_s for one in found]) > 0).all()
    (sentence,) = pairing.said()
    assert sentence.startswith(f"the sender's clock was set {'ahead' if by_s > 0 else 'back'} by")


def test_clocks_that_differ_are_said_and_arrival_counts():
    messages = []
    for i in range(40):
        messages += [image(START + i * STEP), tool("Probe", (50 << 32) + i * STEP, i)]
    pairing, found = items(messages)
    assert any("clocks that differ" in one for one in pairing.said())
    assert len(found) > 35
    assert sum(x is not None for x in xs(found, PROBE)) > 30


def test_messages_without_stamps_are_paired_by_their_arrival():
    pairing, found = items([one for i in range(20) for one in (image(0), tool("Probe", 0, i))])
    assert [one.startswith("messages carry no stamps") for one in pairing.said()] == [True]
    assert len(found) == 20
    np.testing.assert_allclose(xs(found, PROBE)[2:-2], np.arange(2, 18) - 0.5, atol=0.51)


def test_of_two_devices_images_are_taken_of_the_first_or_of_the_one_that_is_named():
    def other(at):
        return igtl.Message(igtl.Image.of(pixels(shape=(8, 8))), "Video", at)

    messages = [one for i in range(5) for one in (image(START + i * STEP), other(START + i * STEP))]
    pairing, found = items(messages)
    assert {one.image.shape for one in found} == {(20, 30)}
    assert len(pairing.said()) == 1
    _, found = items(messages, image="Video")
    assert {one.image.shape for one in found} == {(8, 8)}


def test_what_comes_in_parts_is_put_together():
    whole = pixels(shape=(20, 30))
    messages = []
    for part, at in ((whole[:10], (0, 0, 0)), (whole[10:], (0, 10, 0))):
        content = igtl.Image(part[None], (30, 20, 1), at)
        messages.append(igtl.Message(content, "Image", START))
    _, found = items(messages)
    np.testing.assert_array_equal(found[-1].image, whole)


def test_colour_becomes_grey_and_grey_as_colour_stays_what_it_was():
    grey = pixels(shape=(20, 30))
    content = igtl.Image.of(np.repeat(grey[None, :, :, None], 3, axis=3))
    _, found = items([igtl.Message(content, "Image", START)])
    np.testing.assert_array_equal(found[0].image, grey)


def test_a_name_that_no_recording_could_hold_is_made_one_that_it_can():
    messages = [image(START), igtl.Message(igtl.Transform(pose()), "a b=\nc", START)]
    _, found = items(messages)
    assert list(found[0].poses) == [("a_b__c", "Tracker")]


def test_tools_without_end_take_no_memory_without_end():
    messages = [tool(f"T{i}", START + i) for i in range(200)]
    pairing, _ = items(messages)
    assert len(pairing.tools) == 40
    assert len(pairing.said()) == 1
