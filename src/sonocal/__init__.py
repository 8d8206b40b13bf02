"""Calibrate a tracked ultrasound probe with a tracked needle."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sonocal.calibration import Calibration, ErrorStatistics
    from sonocal.calibration import load_calibration as load
    from sonocal.calibration.calibrate import calibrate
    from sonocal.errors import (
        DegenerateGeometryError,
        FormatError,
        InputError,
        NoConsensusError,
        SonocalError,
        UnsupportedError,
    )
    from sonocal.findings import Diagnostic
    from sonocal.geometry import AxisScaled, Similarity
    from sonocal.observations import Observations, read_observations, write_observations
    from sonocal.reconstruction import Volume, reconstruct
    from sonocal.recording import Recording
    from sonocal.recording.formats import read_recording, write_recording
    from sonocal.sweep import calibrate_recording
    from sonocal.targets import Line

__version__ = "0.1.0"

__all__ = [
    "AxisScaled",
    "Calibration",
    "DegenerateGeometryError",
    "Diagnostic",
    "ErrorStatistics",
    "FormatError",
    "InputError",
    "Line",
    "NoConsensusError",
    "Observations",
    "Recording",
    "Similarity",
    "SonocalError",
    "UnsupportedError",
    "Volume",
    "__version__",
    "calibrate",
    "calibrate_recording",
    "load",
    "read_observations",
    "read_recording",
    "reconstruct",
    "write_observations",
    "write_recording",
]

# A room is imported when one of its names is asked for: registration needs no ultrasound, a table no recording.
_ROOMS = {
    "calibration": ("Calibration", "ErrorStatistics", "calibrate"),
    "errors": (
        "DegenerateGeometryError",
        "FormatError",
        "InputError",
        "NoConsensusError",
        "SonocalError",
        "UnsupportedError",
    ),
    "findings": ("Diagnostic",),
    "geometry": ("AxisScaled", "Similarity"),
    "observations": ("Observations", "read_observations", "write_observations"),
    "reconstruction": ("Volume", "reconstruct"),
    "recording": ("Recording",),
    "recording.formats": ("read_recording", "write_recording"),
    "sweep": ("calibrate_recording",),
    "targets": ("Line",),
}
_PLACES = {name: (room, name) for room, names in _ROOMS.items() for name in names}
_PLACES["load"] = ("calibration", "load_calibration")
# `sonocal.registration.register` and its like work after `import sonocal` alone.
_FURTHER = (
    "detection",
    "existing",
    "export",
    "igtl",
    "registration",
    "report",
    "setup_checks",
    "simulation",
    "studies",
    "tools",
    "validation",
)
_ALL_ROOMS = {room.partition(".")[0] for room in _ROOMS} | set(_FURTHER)


def __getattr__(name: str) -> Any:
    if name in _ALL_ROOMS:
        return import_module(f"{__name__}.{name}")
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    room, own_name = _PLACES[name]
    value = globals()[name] = getattr(import_module(f"{__name__}.{room}"), own_name)
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *_ALL_ROOMS, "__doc__", "__file__", "__name__", "__path__"})
