"""From a recording to a calibration: detections, the table of sightings, choice, a second look."""

from sonocal.sweep.calibrate import Sweep, calibrate_points
from sonocal.sweep.choice import CandidateCalibration, calibrate_candidates
from sonocal.sweep.options import Options, PointsOptions
from sonocal.sweep.recordings import calibrate_recording
from sonocal.sweep.tabulate import Posing, Sightings, tabulate

__all__ = [
    "CandidateCalibration",
    "Options",
    "PointsOptions",
    "Posing",
    "Sightings",
    "Sweep",
    "calibrate_candidates",
    "calibrate_points",
    "calibrate_recording",
    "tabulate",
]
