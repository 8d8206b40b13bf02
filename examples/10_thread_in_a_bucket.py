"""A thread in a bucket of water that nobody measured: the calibration and the thread's place from one scan.

Makes a recording of a probe that is moved over a thread, and calibrates from its images.
"""

from dataclasses import replace

import numpy as np

import sonocal as sc
from sonocal.recording import Poses
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear
from sonocal.targets import Unplaced

options = SweepOptions(frames=120, sigma_px=0.5, sigma_mm=0.3, seed=2)
swept = simulate_sweep(curvilinear(250, 250, 0.48), BATH, options)
# The simulator moves a needle about a probe. Seen from the needle, a probe moves about a thread that rests in the room.
probe, thread = (swept.recording.poses[f"tracker_from_{name}"].matrices for name in ("probe", "needle"))
poses = Poses.of("Probe", "Tracker", np.linalg.inv(thread) @ probe)
recording = replace(swept.recording, poses={poses.name: poses})

found = sc.calibrate_recording(recording, [Unplaced("line", "thread", "Tracker")])
calibration = found.calibration
print(calibration)

target = calibration.targets["thread"]
print(
    "the thread passes",
    target.middle_mm.round(2),
    f"mm in the room, known to {target.sigma_mm:.2f} mm across it",
)
print(
    "along",
    np.round(target.direction, 4),
    f"known to {target.sigma_deg:.2f} deg; it really lies along z, through 0",
)

corners = np.array([[0.0, 0.0], [249.0, 0.0], [0.0, 249.0], [249.0, 249.0]])
off = np.linalg.norm(calibration.probe_from_image @ corners - swept.truth.probe_from_image @ corners, axis=1)
print(
    "corners of the image are off by",
    off.round(2),
    "mm; stated:",
    calibration.predicted_errors()[2][:4].round(2),
)

# What the motion cannot tell is refused by its name: here the probe does not turn.
still = replace(poses, matrices=np.tile(np.eye(4), (len(recording), 1, 1)))
try:
    sc.calibrate_recording(
        replace(recording, poses={poses.name: still}), [Unplaced("line", "thread", "Tracker")]
    )
except sc.SonocalError as refusal:
    print("without turns:", refusal)
