"""Recordings from whatever recorded them: a format a file, and the registry that tells them apart."""

from sonocal.recording.formats.registry import read_recording, write_recording

__all__ = ["read_recording", "write_recording"]
