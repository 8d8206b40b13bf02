"""The file of what is true of a simulated sweep: ``truth.json``."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from sonocal.errors import FormatError, UnsupportedError
from sonocal.files import read_bytes
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.simulation.sweep import SimulatedSweep
from sonocal.simulation.target_sweep import SimulatedTargets

__all__ = ["KnownTruth", "read_truth", "targets_truth_json", "truth_json"]

KIND: Literal["sonocal-truth"] = "sonocal-truth"
VERSION = 1


class _Record(msgspec.Struct, kw_only=True):
    """The file's fields."""

    format: Literal["sonocal-truth"]
    version: int
    probe_from_image: list[list[float]]
    latency_s: float
    visible: list[bool]
    clear: list[bool] = []
    options: dict[str, Any] = {}


@dataclass(frozen=True, eq=False)
class KnownTruth:
    """What the file holds of a sweep, but for its points.

    Attributes:
        name: of the file.
        probe_from_image: (4, 4): the calibration, mm from px.
        latency_s: of the tracker behind the images.
        visible: (N,): whether the needle shows in each image.
        options: of the simulation.
    """

    name: str
    probe_from_image: Array
    latency_s: float
    visible: NDArray[np.bool_]
    options: dict[str, Any]

    __repr__ = brief


def truth_json(sweep: SimulatedSweep) -> bytes:
    """What is true of a sweep, as the text of its file."""
    truth = sweep.truth
    record = {
        "format": KIND,
        "version": VERSION,
        "probe_from_image": truth.probe_from_image.matrix.tolist(),
        "latency_s": truth.latency_s,
        "points_px": truth.points_px.tolist(),
        "visible": truth.visible.tolist(),
        "clear": truth.clear.tolist(),
        "options": asdict(sweep.options),
    }
    return (json.dumps(record, indent=1) + "\n").encode()


def targets_truth_json(sweep: SimulatedTargets) -> bytes:
    """What is true of a sweep of targets, likewise."""
    truth = sweep.truth
    record = {
        "format": KIND,
        "version": VERSION,
        "probe_from_image": truth.probe_from_image.matrix.tolist(),
        "latency_s": 0.0,
        "target": [sweep.targets[i].name for i in truth.target],
        "visible": truth.visible.tolist(),
        "options": asdict(sweep.options),
    }
    return (json.dumps(record, indent=1) + "\n").encode()


def read_truth(path: Path) -> KnownTruth:
    """Read what `truth_json` wrote.

    Raises:
        FormatError: it is damaged.
        UnsupportedError: a later sonocal wrote it.
    """
    try:
        record = msgspec.json.decode(read_bytes(path), type=_Record)
        matrix = np.array(record.probe_from_image)
    except (msgspec.DecodeError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise FormatError(
            f"{path.name}: is a damaged file of a simulation's truth ({error}); simulate again"
        ) from None
    if record.version > VERSION:
        raise UnsupportedError(
            f"{path.name}: has version {record.version} of its format and this sonocal reads up to {VERSION}; update "
            "sonocal"
        )
    if matrix.shape != (4, 4):
        raise FormatError(
            f"{path.name}: probe_from_image has shape {matrix.shape} and not (4, 4); simulate again"
        )
    return KnownTruth(
        path.name, matrix, record.latency_s, np.array(record.visible, dtype=bool), record.options
    )
