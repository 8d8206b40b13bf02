"""From a recording to a calibration: detections, the table of sightings, choice, a second look."""

from sonocal.sweep.calibrate import calibrate_points, calibrate_recording
from sonocal.sweep.choice import CandidateCalibration, calibrate_candidates
from sonocal.sweep.detections import Detections, read_detections
from sonocal.sweep.sightings import Sightings, observations_from_recording

__all__ = [
    "CandidateCalibration",
    "Detections",
    "Sightings",
    "calibrate_candidates",
    "calibrate_points",
    "calibrate_recording",
    "observations_from_recording",
    "read_detections",
]
