"""Calibrate a tracked ultrasound probe with a tracked needle."""

from sonocal.calibration import Calibration, ErrorStatistics, calibrate
from sonocal.calibration_file import load_calibration as load
from sonocal.errors import (
    DegenerateGeometryError,
    FormatError,
    InputError,
    NoConsensusError,
    SonocalError,
    UnsupportedError,
)
from sonocal.geometry import AxisScaled, Similarity
from sonocal.observations import Observations, read_observations, write_observations

__version__ = "0.1.0"

__all__ = [
    "AxisScaled",
    "Calibration",
    "DegenerateGeometryError",
    "ErrorStatistics",
    "FormatError",
    "InputError",
    "NoConsensusError",
    "Observations",
    "Similarity",
    "SonocalError",
    "UnsupportedError",
    "__version__",
    "calibrate",
    "load",
    "read_observations",
    "write_observations",
]
