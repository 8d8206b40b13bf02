"""A threshold that no image keeps: the refusal names it, and not the images."""

import numpy as np
import pytest
from benchmarks.simulators.trust_faults import Case
from benchmarks.simulators.trust_judge import NEEDLE, candidates, recording
from benchmarks.simulators.trust_scans import sound

import sonocal as sc
from sonocal.sweep import calibrate_points


def refused(points_from, threshold_mm):
    scan = sound(3, 100)
    with pytest.raises(sc.NoConsensusError) as caught:
        calibrate_points(recording(scan), [NEEDLE], points_from(scan), threshold_mm=threshold_mm)
    return caught.value


def seen(scan):
    return candidates(Case(scan))


def seen_elsewhere(scan):
    order = np.random.default_rng(0).permutation(len(scan.points_px))
    return candidates(Case(scan.but(points_px=scan.points_px[order])))


@pytest.mark.parametrize("threshold_mm", [1e-6, 0.01])
def test_a_threshold_below_the_noise_is_named_with_one_that_is_enough(threshold_mm):
    error = refused(seen, threshold_mm)
    assert [one.code for one in error.diagnostics] == ["threshold-below-noise"]
    noise_mm = float(str(error).removeprefix("with a noise of ").split()[0])
    enough_mm = float(str(error).split("auto, or ")[1].split()[0])
    assert 0.2 < noise_mm < 0.6
    assert enough_mm == pytest.approx(3.3 * noise_mm, rel=0.05)
    assert f"the threshold of {threshold_mm:.3g} mm leaves out, 100 of 100 images agree" in str(error)


def test_points_of_other_images_are_not_said_to_be_noisy():
    codes = {one.code for one in refused(seen_elsewhere, 0.01).diagnostics}
    assert "threshold-below-noise" not in codes
