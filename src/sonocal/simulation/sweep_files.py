"""A simulated sweep on disk: the recording as PLUS writes one, the needle, and the truth beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from sonocal.files import make_folder, write_atomically
from sonocal.recording import Frames
from sonocal.recording.formats import write_recording
from sonocal.recording.frames import Image
from sonocal.simulation.sweep import SimulatedSweep
from sonocal.simulation.target_sweep import SimulatedTargets
from sonocal.simulation.truth_file import targets_truth_json, truth_json
from sonocal.targets import Line, Plane, Point, lines_toml, write_lines

__all__ = ["SWEEP_FILES", "TARGET_FILES", "write_sweep", "write_targets"]

SWEEP_FILES = ("sweep.igs.mha", "needle.toml", "truth.json")
TARGET_FILES = ("sweep.igs.mha", "targets.toml", "truth.json")

Progress = Callable[[int, int], None]


def write_sweep(sweep: SimulatedSweep, folder: str | Path, progress: Progress | None = None) -> list[Path]:
    """Write ``sweep.igs.mha``, ``needle.toml`` and ``truth.json``; images are made and written one at a time.

    Args:
        sweep: the sweep.
        folder: made if it is absent.
        progress: called with how many images are done and how many there are.

    Returns:
        The files.

    Raises:
        InputError: the folder or a file cannot be written.
    """
    make_folder(folder)
    paths = [Path(folder) / name for name in SWEEP_FILES]
    recording = replace(sweep.recording, frames=_Counted(sweep.recording.frames, progress))
    write_recording(recording, paths[0])
    write_lines(sweep.lines, paths[1])
    write_atomically(paths[2], truth_json(sweep))
    return paths


def write_targets(
    sweep: SimulatedTargets, folder: str | Path, progress: Progress | None = None
) -> list[Path]:
    """Write ``sweep.igs.mha``, ``targets.toml`` and ``truth.json``. As `write_sweep`."""
    make_folder(folder)
    paths = [Path(folder) / name for name in TARGET_FILES]
    recording = replace(sweep.recording, frames=_Counted(sweep.recording.frames, progress))
    write_recording(recording, paths[0])
    lines, points, planes = (
        [one for one in sweep.targets if isinstance(one, Line)],
        [one for one in sweep.targets if isinstance(one, Point)],
        [one for one in sweep.targets if isinstance(one, Plane)],
    )
    write_atomically(paths[1], lines_toml(paths[1].name, lines, points, planes=planes))
    write_atomically(paths[2], targets_truth_json(sweep))
    return paths


class _Counted(Frames):
    """Frames that report how far reading has come."""

    def __init__(self, frames: Frames, progress: Progress | None) -> None:
        self._frames, self._progress = frames, progress
        self.shape, self.dtype = frames.shape, frames.dtype

    def __len__(self) -> int:
        return len(self._frames)

    def read(self, index: int) -> Image:
        """Frame `index`."""
        if self._progress is not None:
            self._progress(index + 1, len(self))
        return self._frames.read(index)
