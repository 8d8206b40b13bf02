"""Recordings: images, the poses of tracked tools, and when they were taken."""

from sonocal.recording.frames import ArrayFrames, Frames
from sonocal.recording.health import Summary, ToolSummary, health, summarize
from sonocal.recording.joining import join, join_several, with_latency
from sonocal.recording.model import ImageGeometry, Provenance, Recording
from sonocal.recording.poses import Poses
from sonocal.recording.signals import bottom_line_signal
from sonocal.recording.stated import StatedScale, stated_scale
from sonocal.recording.stream import Item, RecordingStream
from sonocal.recording.timing import (
    Lag,
    estimate_latency,
    interpolate_poses,
    motion_signal,
)

__all__ = [
    "ArrayFrames",
    "Frames",
    "ImageGeometry",
    "Item",
    "Lag",
    "Poses",
    "Provenance",
    "Recording",
    "RecordingStream",
    "StatedScale",
    "Summary",
    "ToolSummary",
    "bottom_line_signal",
    "estimate_latency",
    "health",
    "interpolate_poses",
    "join",
    "join_several",
    "motion_signal",
    "stated_scale",
    "summarize",
    "with_latency",
]
