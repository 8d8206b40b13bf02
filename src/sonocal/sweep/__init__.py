"""From a recording to a calibration: detections, the table of sightings, choice, a second look."""

from sonocal.sweep.calibrate import Sweep, calibrate_points
from sonocal.sweep.choice import CandidateCalibration, calibrate_candidates
from sonocal.sweep.guidance import Reach, first_holds, holds_met, next_holds
from sonocal.sweep.hold import Hold, held
from sonocal.sweep.options import Options, PointsOptions
from sonocal.sweep.recordings import calibrate_recording, sweep_of
from sonocal.sweep.session import Session
from sonocal.sweep.tabulate import Posing, Sightings, tabulate
from sonocal.sweep.targets import TargetSweep
from sonocal.sweep.unplaced_sweep import UnplacedSweep

__all__ = [
    "CandidateCalibration",
    "Hold",
    "Options",
    "PointsOptions",
    "Posing",
    "Reach",
    "Session",
    "Sightings",
    "Sweep",
    "TargetSweep",
    "UnplacedSweep",
    "calibrate_candidates",
    "calibrate_points",
    "calibrate_recording",
    "first_holds",
    "held",
    "holds_met",
    "next_holds",
    "sweep_of",
    "tabulate",
]
