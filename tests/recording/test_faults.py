"""A recording's findings are the faults that were put in, all of them and no other."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal.recording import ArrayFrames, Poses, Recording, health, summarize
from tests.builders.motion import random_twist, recording_of
from tests.builders.recordings import random_poses

COUNT = 60
seeds = st.integers(0, 10_000)


def sound(seed):
    return recording_of(
        {"Probe": random_twist(seed), "Needle": random_twist(seed + 1)}, np.arange(COUNT) * 0.05
    )


def with_probe(recording, change: Callable[[Poses], Poses]) -> Recording:
    return replace(
        recording,
        poses={**recording.poses, "tracker_from_probe": change(recording.poses["tracker_from_probe"])},
    )


def invalid(recording):
    return with_probe(recording, lambda poses: replace(poses, valid=np.arange(COUNT) % 5 > 0))


def bent(recording):
    def bend(poses):
        matrices = poses.matrices.copy()
        matrices[31, :3, :3] *= 1.1
        return replace(poses, matrices=matrices)

    return with_probe(recording, bend)


def frozen(recording):
    return with_probe(
        recording, lambda poses: replace(poses, matrices=poses.matrices[np.minimum(np.arange(COUNT), 40)])
    )


def gapped(recording):
    return replace(recording, times=recording.times + np.where(np.arange(COUNT) > 20, 3.0, 0.0))


def repeated_stamp(recording):
    times = recording.times.copy()
    times[8] = times[7]
    return replace(recording, times=times)


def out_of_order(recording):
    times = recording.times.copy()
    times[[50, 51]] = times[[51, 50]]
    return replace(recording, times=times)


def repeated_image(recording):
    pixels = np.stack(list(recording.frames))
    pixels[12] = pixels[11]
    return replace(recording, frames=ArrayFrames(pixels))


def invalid_image(recording):
    return replace(recording, image_valid=np.arange(COUNT) != 5)


FAULTS = {
    "invalid-poses": invalid,
    "non-rigid-poses": bent,
    "frozen-poses": frozen,
    "gaps": gapped,
    "stamps-repeated": repeated_stamp,
    "stamps-out-of-order": out_of_order,
    "duplicated-images": repeated_image,
    "invalid-images": invalid_image,
}


@given(seeds, st.sets(st.sampled_from(sorted(FAULTS))))
def test_the_findings_are_the_faults_put_in(seed, faults):
    recording = sound(seed)
    for name, put_in in FAULTS.items():
        if name in faults:
            recording = put_in(recording)
    assert {finding.code for finding in health(recording)} == faults


@given(seeds, st.sets(st.sampled_from(sorted(FAULTS))))
def test_every_finding_says_what_and_what_to_do(seed, faults):
    recording = sound(seed)
    for name in sorted(faults):
        recording = FAULTS[name](recording)
    for finding in health(recording):
        assert any(letter.isdigit() for letter in finding.message)
        assert finding.advice
        assert "\n" not in finding.message + finding.advice


@given(seeds, st.sampled_from(sorted(FAULTS)))
def test_the_tracker_may_stand_anywhere(seed, fault):
    """Findings are of the recording, not of the room's axes."""
    recording = FAULTS[fault](sound(seed))
    mover = random_poses(np.random.default_rng(seed), 1)[0]
    moved = replace(
        recording, poses={n: replace(p, matrices=mover @ p.matrices) for n, p in recording.poses.items()}
    )
    assert [f.code for f in health(moved)] == [f.code for f in health(recording)]


@given(seeds, st.lists(st.booleans(), min_size=COUNT, max_size=COUNT))
def test_the_summary_counts_valid_poses_and_the_longest_loss(seed, valid):
    recording = with_probe(sound(seed), lambda poses: replace(poses, valid=np.array(valid)))
    probe, needle = summarize(recording).tools
    longest = max(map(len, "".join("x" if ok else "." for ok in valid).split("x")))
    assert (probe.name, probe.poses, probe.valid, probe.longest_loss) == (
        "ProbeToTracker",
        COUNT,
        sum(valid),
        longest,
    )
    assert (needle.valid, needle.longest_loss) == (COUNT, 0)


@given(seeds, st.floats(2, 60))
def test_rate_and_duration_are_those_of_the_stamps(seed, rate):
    recording = replace(sound(seed), times=100.0 + np.arange(COUNT) / rate)
    summary = summarize(recording)
    assert summary.rate_hz == pytest.approx(rate, rel=1e-6)
    assert summary.duration_s == pytest.approx((COUNT - 1) / rate, rel=1e-6)
    assert summarize(replace(recording, times=np.full(COUNT, np.nan))).rate_hz is None


@pytest.mark.parametrize("run", [1, 9, 10, 30])
def test_images_that_stand_still_are_frozen_and_one_that_repeats_is_a_duplicate(run):
    pixels = np.stack(list(sound(0).frames))
    pixels[10 : 11 + run] = pixels[10]
    (finding,) = health(replace(sound(0), frames=ArrayFrames(pixels)))
    assert finding.code == ("frozen-images" if run >= 10 else "duplicated-images")
    assert f"first at frame 11, up to {run} in a row" in finding.message


def test_images_are_not_decoded_where_nobody_asks_for_them():
    recording = repeated_image(sound(0))
    assert health(recording, look_at_images=False) == ()
    seen = []
    health(recording, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(i + 1, COUNT) for i in range(COUNT)]
