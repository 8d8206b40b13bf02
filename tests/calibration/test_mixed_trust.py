"""Mixes of beads, wires and walls: what is wrong with a scan is named, or its error is within the bound."""

import numpy as np
import pytest
from benchmarks.simulators.mixed_judge import judged, table
from benchmarks.simulators.mixed_scans import FAULTS, PHANTOMS, clean, sound

import sonocal as sc
from sonocal.validation import give_verdict

MIXES = tuple(PHANTOMS)
NAMED = {
    "lengths in metres": {"implausible-units"},
    "lengths in centimetres": {"implausible-units"},
    "mirrored image": {"flipped-image", "MirroredVolumeError", "NoConsensusError"},
    "latency": {"latency"},
    "slipped marker": {"marker-slipped"},
    "unequal pixels": {"anisotropic-scale"},
    "outliers": {"many-outliers"},
}


@pytest.mark.parametrize("mix", MIXES)
def test_a_scan_without_noise_is_of_the_truth(mix):
    scan = clean(mix, 3)
    places = scan.points_px @ scan.truth[:3, : scan.points_px.shape[1]].T + scan.truth[:3, 3]
    away = places - scan.spanning_probe()[:, 0]
    for spans in np.unique(scan.spans):
        rows = scan.spans == spans
        sides = (scan.spanning_probe()[rows, 1:spans] - scan.spanning_probe()[rows, :1]).transpose(0, 2, 1)
        along = np.linalg.pinv(sides) @ away[rows][:, :, None] if spans > 1 else 0.0
        left = away[rows] - ((sides @ along)[:, :, 0] if spans > 1 else 0.0)
        assert np.abs(left).max() < 1e-3


@pytest.mark.parametrize("mix", MIXES)
def test_a_sound_scan_is_used(mix):
    for seed in range(3):
        outcome = judged(sound(mix, seed), expected=True)
        assert outcome.level == "use", outcome


@pytest.mark.parametrize("mix", MIXES)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_or_within_the_bound(mix, fault):
    make, strength, _ = FAULTS[fault]
    outcome = judged(make(mix, 1, strength), expected=fault == "mirrored image")
    assert not outcome.confidently_wrong
    if fault in NAMED:
        assert NAMED[fault] & set(outcome.codes), outcome


def test_a_scan_pasted_twice_counts_once():
    scan = sound("beads and wires", 2)
    rows = table(scan)
    again = scan.but(
        time_s=np.concatenate([scan.time_s, scan.time_s + 20.0]),
        frame=np.concatenate([scan.frame, scan.frame + scan.frame.max() + 1]),
        **{
            name: np.concatenate([getattr(scan, name)] * 2)
            for name in ("target", "spans", "points_px", "spanning_mm", "tracker_from_probe")
        },
    )
    once, twice = sc.calibrate(rows), sc.calibrate(table(again))
    assert "repeated-rows" in {one.code for one in twice.warnings}
    np.testing.assert_allclose(twice.covariance, once.covariance, rtol=1e-6)
    assert len(twice.inlier) == 2 * len(once.inlier)


def test_rows_that_share_a_frame_widen_the_error():
    scan, rng = sound("lines and planes, 3D", 4), np.random.default_rng(0)
    shaken = scan.but(
        spanning_mm=scan.spanning_mm + rng.normal(size=(scan.frame.max() + 1, 1, 3))[scan.frame]
    )
    found = sc.calibrate(table(shaken))
    assert found.noise.shared_mm["frame"] == pytest.approx(1.0, rel=0.4)
    assert give_verdict(found).level == "use"


def test_a_held_out_wall_that_is_elsewhere_is_a_surprise():
    scan = sound("walls", 1)
    wall = scan.target == "wall 0"
    rows = table(scan.but(spanning_mm=scan.spanning_mm + 4.0 * wall[:, None, None]))
    split = np.where(wall, "test", "fit")
    torn = sc.Observations.of_targets(
        rows.points_px, rows.spanning_mm, frame=rows.frame, target=rows.target, split=split
    )
    found = sc.calibrate(torn, test_split="test")
    assert {"held-out-rows-off", "held-out-rows-far-off"} & {one.code for one in found.warnings}
