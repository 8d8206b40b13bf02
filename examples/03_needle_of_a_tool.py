"""Where a needle is on its marker: its tip from a pivot, its shaft from a spin.

Writes needle.toml, which sonocal calibrate --lines reads.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from sonocal.targets import write_lines
from sonocal.tools import calibrate_pivot, calibrate_spin, needle_from_axis

TIP, SHAFT = np.array([2.0, -1.0, -180.0]), np.array([0.01, -0.005, 1.0])
SHAFT = SHAFT / np.linalg.norm(SHAFT)
random = np.random.default_rng(0)


def poses(rotations: Rotation, at: np.ndarray, rests: np.ndarray) -> np.ndarray:
    """Poses of the marker, with tracking noise, while one of its points rests."""
    matrices = np.tile(np.eye(4), (len(rotations), 1, 1))
    matrices[:, :3, :3] = rotations.as_matrix()
    matrices[:, :3, 3] = rests - rotations.apply(at) + random.normal(scale=0.1, size=(len(rotations), 3))
    return matrices


# The handle is turned to all sides, some 30 degrees, while the tip rests in a dent.
tilts = Rotation.from_rotvec(random.uniform(-0.5, 0.5, (300, 3)))
pivot = calibrate_pivot(poses(tilts, TIP, np.array([100.0, -50.0, -900.0])))
print(f"tip at {pivot.tip_mm.round(2)} mm, within {pivot.tip_95_mm:.2f} mm (95 %)")

# It is spun about its shaft, lying in a groove.
turns = Rotation.from_rotvec(np.linspace(0, 5, 300)[:, None] * SHAFT)
spin = calibrate_spin(poses(turns, TIP, np.array([0.0, 0.0, -800.0])))

needle = needle_from_axis(pivot, spin, frame="Needle")
for finding in needle.diagnostics:
    print(finding.code, finding.message)
print(needle.line)
write_lines([needle.line], "needle.toml")
