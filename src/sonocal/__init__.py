"""Calibrate a tracked ultrasound probe with a tracked needle."""

from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from sonocal.recording import Recording, read_recording, write_recording

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
    "Recording",
    "Similarity",
    "SonocalError",
    "UnsupportedError",
    "__version__",
    "calibrate",
    "load",
    "read_observations",
    "read_recording",
    "write_observations",
    "write_recording",
]


def __getattr__(name: str) -> Any:
    """What belongs to recordings is imported when it is asked for: tables need none of it."""
    if name not in ("Recording", "read_recording", "write_recording"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from sonocal import recording

    return getattr(recording, name)
