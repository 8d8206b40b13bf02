"""C3D, the format of motion capture: markers, from which rigid bodies are made.

Lengths are in the file's own unit (POINT:UNITS). A marker whose residual is negative was not seen.
See `sonocal.recording.markers` for how markers become poses. Source: the C3D user guide, c3d.org.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, InputError, SonocalError
from sonocal.files import file_size
from sonocal.files.kinds import Format, Head
from sonocal.geometry import Array
from sonocal.recording.formats.parts.packages import needed
from sonocal.recording.formats.parts.pose_columns import in_mm
from sonocal.recording.markers import Markers, bodies_from_markers
from sonocal.recording.model import Provenance, Recording
from sonocal.recording.poses import by_name

__all__ = ["FORMAT", "read_c3d"]

UNITS = {
    **{"mm": ("millimetres", 1.0), "cm": ("centimetres", 10.0), "m": ("metres", 1000.0)},
    **{"in": ("inches", 25.4), "": ("", 1.0)},
}
BLOCK = 512
# The first block of a file points to its parameters, and says with this byte that it is one.
KEY = 0x50
LARGEST = 1 << 30


def read_c3d(path: Path, markers: Markers = ()) -> Recording:
    """Read the markers of a recording as rigid bodies.

    Args:
        path: the file.
        markers: where markers are in their tools' frames.

    Raises:
        UnsupportedError: the package c3d is not installed.
        FormatError: the file is damaged or cut short.
        InputError: its markers are no rigid bodies, or in an unknown unit.
    """
    size = file_size(path)
    if size > LARGEST:
        raise InputError(f"{path.name}: holds {size} bytes, more than the {LARGEST} that are read; cut it")
    package = needed("c3d", path, "C3D needs the package c3d")
    try:
        with path.open("rb") as handle, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is damaged is refused below, or said by no number
            reader = package.Reader(handle)
            labels, unit, rate = _labels(reader), _unit(reader), float(reader.point_rate)
            _check_length(path.name, reader, size)
            places = _places(reader)
    except SonocalError:
        raise
    except Exception as error:  # the package raises many kinds for damaged files
        raise FormatError(f"{path.name}: is damaged ({str(error)[:80]}); record or copy it again") from None
    if unit not in UNITS:
        raise InputError(f"{path.name}: its unit (POINT:UNITS) is {unit[:40]!r}; export mm, cm, m or in")
    if not 0 < rate < np.inf:
        raise InputError(f"{path.name}: {rate:g} frames a second is no rate; export it again")
    name, mm = UNITS[unit]
    found = {label: in_mm(places[:, i], mm) for i, label in enumerate(labels[: places.shape[1]])}
    poses, notes = bodies_from_markers(found, markers, path.name)
    return Recording(
        times=np.arange(len(places)) / rate,
        poses=by_name(poses, path.name),
        provenance=Provenance(path.name, "C3D", (str(path),), name),
        diagnostics=tuple(notes),
    )


def _labels(reader: Any) -> list[str]:
    """The markers' names; they are read only where they are all in the file."""
    parameter = reader.get("POINT:LABELS")
    if parameter is None or np.prod([int(n) for n in parameter.dimensions], dtype=float) > len(
        parameter.bytes
    ):
        raise ValueError("no labels of points")
    return [str(label).strip() for label in parameter.string_array]


def _unit(reader: Any) -> str:
    parameter = reader.get("POINT:UNITS")
    return "" if parameter is None else str(parameter.string_value).strip("\0 ").lower()


def _check_length(name: str, reader: Any, size: int) -> None:
    """Refuse a file without markers, and one shorter than it says: both before its frames are asked for."""
    width = 4 if reader.point_scale < 0 else 2
    frame = width * (4 * int(reader.point_used) + int(reader.analog_used) * int(reader.analog_per_frame))
    if int(reader.point_used) < 1 or int(reader.frame_count) < 1:
        raise InputError(f"{name}: holds no markers; export those of the tools")
    there = max(0, size - (int(reader.header.data_block) - 1) * BLOCK) // frame
    count = int(reader.last_frame) - int(reader.first_frame) + 1
    if there < count:
        raise FormatError(f"{name}: is cut short: it says {count} frames and holds {there}; copy it again")


def _places(reader: Any) -> Array:
    """(N, M, 3) in the file's unit; NaN where a marker was not seen."""
    frames = [points[:, :4].copy() for _, points, _ in reader.read_frames(copy=False)]
    table = np.array(frames, dtype=float)
    return np.where(table[:, :, 3:] < 0, np.nan, table[:, :, :3])


def _sniff(head: Head) -> bool:
    # Its first byte is where the parameters start, most often block 2.
    return len(head.content) > BLOCK and head.content[1] == KEY and 1 < head.content[0] < BLOCK // 4


FORMAT = Format(
    name="C3D",
    kind="recording",
    suffixes=(".c3d",),
    sniff=_sniff,
    read=read_c3d,
    options=("markers",),
    holds="markers of rigid bodies, with `--markers` or labelled `Tool:marker`; lengths in the file's own unit",
    needs=("c3d",),
)
