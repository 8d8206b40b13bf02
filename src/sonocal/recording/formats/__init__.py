"""Recordings from whatever recorded them: a format a file, and the registry that tells them apart.

A new format is a file here that ends with its `FORMAT`, and a line in `registry.FORMATS`; what several formats are
made of is in `parts`. docs/formats.md has the steps.
"""

from sonocal.recording.formats.parts.growing import GrowingSequence
from sonocal.recording.formats.registry import read_recording, write_recording

__all__ = ["GrowingSequence", "read_recording", "write_recording"]
