"""Recordings: images and the poses of tracked tools, from whatever recorded them."""

from sonocal.findings import Diagnostic
from sonocal.recording.device_set import DeviceSet, read_device_set, read_lines
from sonocal.recording.frames import ArrayFrames, Frames
from sonocal.recording.health import Summary, ToolSummary, health, summarize
from sonocal.recording.lines import Line, Point, lines_toml, read_points_toml, write_lines
from sonocal.recording.model import ImageGeometry, Provenance, Recording
from sonocal.recording.needle import (
    DigitisedPoint,
    NeedleCalibration,
    digitise_point,
    needle_from_axis,
    needle_from_points,
    needle_from_spin,
)
from sonocal.recording.pivot import PivotCalibration, calibrate_pivot
from sonocal.recording.poses import Poses
from sonocal.recording.reading import read_recording, write_recording
from sonocal.recording.signals import bottom_line_signal
from sonocal.recording.spin import SpinCalibration, calibrate_spin
from sonocal.recording.timing import (
    Lag,
    estimate_latency,
    interpolate_poses,
    join,
    motion_signal,
    with_latency,
)

__all__ = [
    "ArrayFrames",
    "DeviceSet",
    "Diagnostic",
    "DigitisedPoint",
    "Frames",
    "ImageGeometry",
    "Lag",
    "Line",
    "NeedleCalibration",
    "PivotCalibration",
    "Point",
    "Poses",
    "Provenance",
    "Recording",
    "SpinCalibration",
    "Summary",
    "ToolSummary",
    "bottom_line_signal",
    "calibrate_pivot",
    "calibrate_spin",
    "digitise_point",
    "estimate_latency",
    "health",
    "interpolate_poses",
    "join",
    "lines_toml",
    "motion_signal",
    "needle_from_axis",
    "needle_from_points",
    "needle_from_spin",
    "read_device_set",
    "read_lines",
    "read_points_toml",
    "read_recording",
    "summarize",
    "with_latency",
    "write_lines",
    "write_recording",
]
