"""The main path: from a table of sightings to a calibration that says how far to trust it."""

from sonocal.calibration.calibrate import calibrate
from sonocal.calibration.evidence import evidence_of
from sonocal.calibration.fit import FittedRows, fit_rows
from sonocal.calibration.found_phantom import FoundPhantom
from sonocal.calibration.found_targets import FoundTarget
from sonocal.calibration.labelled import LabelledDots, WireHits
from sonocal.calibration.options import Options
from sonocal.calibration.placed import placed_by
from sonocal.calibration.result import Calibration, calibration_json, load_calibration, parse_calibration
from sonocal.calibration.rows import line_distances, point_line_rows
from sonocal.calibration.sound import Sound, seen_at_assumed_speed
from sonocal.calibration.statistics import ErrorStatistics

__all__ = [
    "Calibration",
    "ErrorStatistics",
    "FittedRows",
    "FoundPhantom",
    "FoundTarget",
    "LabelledDots",
    "Options",
    "Sound",
    "WireHits",
    "calibrate",
    "calibration_json",
    "evidence_of",
    "fit_rows",
    "line_distances",
    "load_calibration",
    "parse_calibration",
    "placed_by",
    "point_line_rows",
    "seen_at_assumed_speed",
]
