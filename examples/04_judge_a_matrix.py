"""A matrix that you have already, from PLUS, 3D Slicer or a script: what it means, and how far it is off on a sweep.

Writes old.txt, the matrix, which here is right but for a depth setting that was changed: its scale is 4 % too large.
"""

import numpy as np

import sonocal as sc
from sonocal.existing import meaning_of, read_existing
from sonocal.existing.worth import worth_of
from sonocal.simulation.sample import sample_sweep

sweep = sample_sweep()
old = sweep.truth.probe_from_image.matrix.copy()
old[:3, :3] *= 1.04
np.savetxt("old.txt", old)

existing = read_existing("old.txt")
meaning = meaning_of(existing.matrix)
print(
    f"{existing.said}: {meaning.scales_mm_per_px[0]:.4f} mm/px along u, {meaning.scales_mm_per_px[1]:.4f} along v"
)

rows = sc.calibrate_recording(sweep.recording, sweep.lines).observations
worth = worth_of(existing, rows)
for quantity, ours in zip(worth.quantities, worth.own_quantities, strict=True):
    print(f"{quantity.title}: {quantity.value_mm:.2f} mm; our own calibration: {ours.value_mm:.2f} mm")
for finding in worth.diagnostics:
    print(f"{finding.severity} {finding.code}: {finding.message}\n  what to do: {finding.advice}")
