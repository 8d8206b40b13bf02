"""Each wrong set-up is found on data made wrong in exactly that way, and sound data are left alone."""

import dataclasses
import functools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.setup_checks import (
    check_flip,
    check_latency,
    check_needle_end,
    check_scale,
    check_setup,
    check_slip,
    check_tool_frame,
)
from tests.setup_checks.scans import SCALE, scan

SEEDS = range(50)
# Of 50 scans: found in at least, raised without cause in at most.
FOUND, FALSE = 48, 2


@functools.cache
def sound(seed, dimension=2):
    one = scan(seed, dimension=dimension)
    return one, sc.calibrate(one.observations)


def raised(findings, code):
    return [finding.code for finding in findings].count(code) == 1


def altered(rows, **columns):
    return dataclasses.replace(rows, **columns)


def carried(rows, poses):
    """The lines, each carried by its row's pose."""
    moved = np.einsum("nij,nkj->nki", poses[:, :3, :3], rows.segments_mm) + poses[:, None, :3, 3]
    return altered(rows, segments_mm=moved)


def rough(rotation, seed):
    """A known orientation as a user knows it: off by some 15 degrees."""
    return rotation @ Rotation.from_rotvec(np.random.default_rng(seed).normal(scale=0.15, size=3)).as_matrix()


@pytest.mark.parametrize("dimension", [2, 3])
def test_sound_scans_are_left_alone(dimension):
    counts = dict.fromkeys(
        [
            "scale-differs-from-scanner",
            "flipped-image",
            "marker-slipped",
            "wrong-tool-frame",
            "wrong-end-of-needle",
            "latency",
            "anisotropic-scale",
        ],
        0,
    )
    for seed in SEEDS:
        one, found = sound(seed, dimension)
        findings = check_setup(
            found,
            one.observations,
            scanner_mm_per_px=SCALE,
            expected=rough(one.truth.rotation, seed),
            tracker_from_probe=one.tracker_from_probe,
        )
        for finding in (*findings, *found.diagnostics):
            if finding.code in counts:
                counts[finding.code] += 1
    assert max(counts.values()) <= FALSE, counts


def test_a_scale_that_is_not_the_scanners():
    found = [check_scale(sound(seed)[1], SCALE * (1.04 if seed % 2 else 0.96)) for seed in SEEDS]
    assert sum(raised(f, "scale-differs-from-scanner") for f in found) >= FOUND


@pytest.mark.parametrize("flip", [(-1, 1), (1, -1), (-1, -1)])
def test_a_flipped_2d_image_against_a_known_orientation(flip):
    count = 0
    for seed in SEEDS:
        one, _ = sound(seed)
        flipped = altered(one.observations, points_px=[250, 250] + (one.observations.points_px - 250) * flip)
        found = sc.calibrate(flipped)
        count += raised(check_flip(found, flipped, expected=rough(one.truth.rotation, seed)), "flipped-image")
    assert count >= FOUND


def test_an_upside_down_2d_image_when_the_marker_is_on_the_handle():
    count = false = 0
    for seed in SEEDS:
        one, found = sound(seed)
        false += raised(check_flip(found, one.observations, marker_above_image=True), "flipped-image")
        upside_down = altered(
            one.observations, points_px=[0, 500] + one.observations.points_px * np.array([1, -1])
        )
        findings = check_flip(sc.calibrate(upside_down), upside_down, marker_above_image=True)
        count += raised(findings, "flipped-image")
    assert count >= FOUND
    assert false <= FALSE


def test_a_mirrored_2d_image_alone_cannot_be_told_and_nothing_is_claimed():
    one, _ = sound(0)
    mirrored = altered(one.observations, points_px=[500, 0] + one.observations.points_px * np.array([-1, 1]))
    assert not list(check_flip(sc.calibrate(mirrored), mirrored))


def test_a_mirrored_volume():
    count = 0
    for seed in SEEDS:
        rows = sound(seed, 3)[0].observations
        mirror = np.ones(3)
        mirror[seed % 3] = -1
        mirrored = altered(rows, points_px=250 + (rows.points_px - 250) * mirror)
        try:
            found = sc.calibrate(mirrored)
        except sc.NoConsensusError:  # refused outright, which warns as well
            count += 1
            continue
        count += raised(check_flip(found, mirrored), "flipped-image")
    assert count >= FOUND


def test_a_marker_that_slipped():
    count = 0
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        turn, shift = rng.normal(size=(2, 3))
        slip = (np.radians(2) * turn / np.linalg.norm(turn), 4 * shift / np.linalg.norm(shift))
        one = scan(seed, slip=slip, slip_at=rng.uniform(0.35, 0.65))
        count += raised(check_slip(sc.calibrate(one.observations), one.observations), "marker-slipped")
    assert count >= FOUND


def test_lines_in_another_frame():
    told = guessed = 0
    for seed in SEEDS:
        one, _ = sound(seed)
        poses = one.tracker_from_probe if seed % 2 else np.linalg.inv(one.tracker_from_probe)
        wrong = carried(one.observations, poses)
        told += raised(check_tool_frame(wrong, tracker_from_probe=one.tracker_from_probe), "wrong-tool-frame")
        guessed += raised(check_tool_frame(wrong), "wrong-tool-frame")
    assert min(told, guessed) >= FOUND


def test_the_frame_that_the_lines_are_in_is_named():
    one, _ = sound(1)
    wrong = carried(one.observations, one.tracker_from_probe)
    (finding,) = check_tool_frame(wrong, tracker_from_probe=one.tracker_from_probe)
    assert "when the lines are taken to be in the tracker's frame" in finding.message


def test_the_wrong_end_of_the_needle():
    """The needle's far end has the wrong sign: the same line, on the other side of its marker."""
    count = 0
    for seed in SEEDS:
        rows = sound(seed)[0].observations
        wrong = rows.segments_mm.copy()
        wrong[:, 1] = 2 * wrong[:, 0] - wrong[:, 1]
        wrong = altered(rows, segments_mm=wrong)
        count += raised(check_needle_end(sc.calibrate(wrong), wrong), "wrong-end-of-needle")
    assert count >= FOUND


@pytest.mark.parametrize("latency_s", [0.1, -0.1])
def test_a_latency_and_its_size(latency_s):
    count = mistaken = 0
    for seed in SEEDS:
        one = scan(seed, latency_s=latency_s)
        found = sc.calibrate(one.observations)
        findings = check_setup(found, one.observations)
        late = "tracker" if latency_s > 0 else "image"
        count += raised(findings, "latency") and f"the {late} is late by " in findings[0].message
        mistaken += raised(findings, "marker-slipped")
    assert count >= FOUND
    assert mistaken <= FALSE


def test_a_latency_comes_out_in_ms_or_in_frames():
    one = scan(3, latency_s=0.1, outliers=0.0)
    found = sc.calibrate(one.observations)
    in_ms = next(check_latency(found, one.observations)).message
    in_frames = next(check_latency(found, altered(one.observations, extra={}))).message
    said = [float(message.split("late by ")[1].split()[0]) for message in (in_ms, in_frames)]
    assert said[0] == pytest.approx(100, rel=0.2)
    assert said[1] == pytest.approx(said[0] / 100, rel=1e-2)
    assert " ms (+-" in in_ms
    assert " frames (+-" in in_frames


def test_pixels_of_unequal_size():
    count = 0
    for seed in SEEDS:
        rows = sound(seed)[0].observations
        found = sc.calibrate(altered(rows, points_px=rows.points_px * [1, 1.06]))
        count += raised(found.diagnostics, "anisotropic-scale")
    assert count >= FOUND


def test_sound_real_data_raise_nothing_and_a_drift_is_no_slip(data_folder):
    for name, model in (
        ("depth15_polaris", "similarity"),
        ("fcal12_ascension", "anisotropic"),
        ("trus_3nwires", "similarity"),
    ):
        rows = sc.read_observations(data_folder / "observations" / f"{name}.csv").select_split("calibration")
        assert not check_setup(sc.calibrate(rows, model=model), rows), name


def test_frames_in_any_order_hide_a_slip():
    """The finding is about time: the same rows in random order have nothing to find."""
    one = scan(0, slip=(np.radians([0, 2, 0]), np.array([4.0, 0, 0])))
    shuffled = altered(
        one.observations, frame=np.random.default_rng(0).permutation(len(one.observations)), extra={}
    )
    found = sc.calibrate(one.observations)
    assert raised(check_slip(found, one.observations), "marker-slipped")
    assert not list(check_slip(found, shuffled))


def test_few_frames_say_nothing_of_time():
    one, found = sound(0)
    few = one.observations.select(np.arange(12))
    assert not list(check_slip(found, few))
    assert not list(check_latency(found, few))


def test_nonsense_is_refused():
    one, found = sound(0)
    with pytest.raises(sc.InputError, match="scanner_mm_per_px must be positive; got -1"):
        list(check_scale(found, -1))
    with pytest.raises(
        sc.InputError, match=r"expected must be the directions of u, v and normal, shape \(3, 3\)"
    ):
        list(check_flip(found, one.observations, expected=np.eye(4)))
