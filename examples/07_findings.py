"""What is said of scans that are wrong, and how a program reacts: by codes, not by words."""

import numpy as np

import sonocal as sc
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import give_verdict


def told(name: str, rows: sc.Observations) -> None:
    """Calibrate, and say what came of it."""
    try:
        calibration = sc.calibrate(rows)
    except sc.DegenerateGeometryError as refusal:  # the data leave a motion free
        print(f"{name}: refused, {refusal.code}: {refusal}")
        return
    except sc.NoConsensusError as refusal:  # too few rows agree
        print(f"{name}: refused: {refusal}")
        return
    verdict = give_verdict(calibration)
    print(f"{name}: {verdict.headline} ({', '.join(verdict.codes) or 'nothing is wrong'})")
    for finding in calibration.warnings:
        print(f"  {finding.message}; {finding.anchor}")


sound = simulate_observations(2, 60, sigma_mm=0.5, seed=2).observations
told("sound", sound)
told("a third nonsense", simulate_observations(2, 60, sigma_mm=0.5, outlier_share=0.33, seed=2).observations)

middle = sound.segments_mm.mean(axis=1, keepdims=True)
parallel = middle + np.array([[[0.0, 0.0, -100.0], [0.0, 0.0, 100.0]]])
told("parallel needles", sc.Observations(sound.points_px, parallel, image_size_px=(500, 500)))

told("in metres", sc.Observations(sound.points_px, sound.segments_mm / 1000, image_size_px=(500, 500)))
