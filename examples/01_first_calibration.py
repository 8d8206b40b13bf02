"""From a recording to a calibration, its verdict, and a transform that 3D Slicer loads.

Writes calibration.json and ImageToProbe.tfm into the folder that it is run in.
"""

from pathlib import Path

import sonocal as sc
from sonocal.export.slicer import slicer_tfm
from sonocal.simulation.sample import sample_sweep
from sonocal.validation import give_verdict

# In the place of these two lines: sc.read_recording("sweep.igs.mha"), and sonocal.targets.read_lines("needle.toml").
sweep = sample_sweep()
recording, lines = sweep.recording, sweep.lines

found = sc.calibrate_recording(recording, lines)
calibration = found.calibration

verdict = give_verdict(calibration)
print(f"{verdict.headline}. {verdict.expectation}")
for finding in calibration.diagnostics:
    print(f"{finding.severity} {finding.code}: {finding.message}\n  what to do: {finding.advice}")

print(calibration.probe_from_image.matrix)  # (4, 4), mm from px
calibration.save("calibration.json")
Path("ImageToProbe.tfm").write_bytes(slicer_tfm(calibration))
