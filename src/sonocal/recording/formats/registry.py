"""Any recording that sonocal reads or writes: the list of formats, and the two functions that choose from it.

A new format is a file beside this one that ends with its `FORMAT`, and a line in `FORMATS`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sonocal.errors import FormatError, InputError, UnsupportedError, require
from sonocal.files import path_of
from sonocal.files.elsewhere import refuse_other_kind
from sonocal.files.kinds import TABLE_SUFFIXES, Format, Head, recognise, refuse_container, suffixes_of
from sonocal.recording.formats import (
    c3d,
    dicom,
    image,
    image_folder,
    kretz,
    metaio,
    motive,
    ndi,
    nrrd,
    pose_csv,
    rosbag,
    slicer_scene,
    tum,
    tus_rec,
    vicon,
    video,
)
from sonocal.recording.formats.parts.angles import check_angles
from sonocal.recording.joining import join_several, with_latency
from sonocal.recording.markers import Markers, check_markers
from sonocal.recording.model import Recording
from sonocal.recording.poses import OnInvalid

__all__ = ["FORMATS", "files_written", "read_recording", "refuse_table", "write_recording"]

# In the order of the documentation. What no format claims by its content goes to the first that its name fits.
FORMATS: tuple[Format, ...] = (
    metaio.FORMAT,
    nrrd.FORMAT,
    slicer_scene.FORMAT,
    pose_csv.FORMAT,
    motive.FORMAT,
    vicon.FORMAT,
    ndi.FORMAT,
    tum.FORMAT,
    c3d.FORMAT,
    video.FORMAT,
    rosbag.FORMAT,
    tus_rec.FORMAT,
    dicom.FORMAT,
    kretz.FORMAT,
    image.FORMAT,
    image_folder.FORMAT,
)


def read_recording(
    path: str | Path,
    poses: str | Path | Sequence[str | Path] | None = None,
    latency_s: float = 0.0,
    on_invalid: OnInvalid = "raise",
    *,
    angles: str | None = None,
    markers: Markers = (),
) -> Recording:
    """Read a recording of any format.

    A video or folder of images without poses is joined by time stamp with its tracker's: those of `poses`, or
    else the ``.csv`` of the same name beside the video, or the one table of poses in the folder.

    Args:
        path: the file, or the folder of images.
        poses: the tracker's own recording, where it is another file; several, where each holds other tools.
        latency_s: how much later the tracker stamps an instant than the images do; poses are moved by it.
        on_invalid: what to do with poses marked valid that are not rigid, where poses are moved or joined.
        angles: what three angles of a pose mean where a file does not say: an order such as "ZYX" (capitals: about the
            tool's own axes; small letters: about the tracker's), or "vector".
        markers: where markers are in the frames of their tools, of recordings that hold markers and no poses.

    Raises:
        InputError: it cannot be read; the sentence says what, where and the remedy.
        UnsupportedError: it is a kind of file that sonocal does not read.
    """
    path = path_of(path)
    told = {"angles": angles and check_angles(angles), "markers": check_markers(markers)}
    found = _recognised(path)
    images = _read(found, path, told)
    files = _files(poses) if poses is not None else [] if images.poses else _poses_beside(path, found)
    formats = [_recognised(file) for file in files]
    _refuse_unused(told, [found, *formats], [path, *files])
    trackers = [_read(one, file, told) for one, file in zip(formats, files, strict=True)]
    if not trackers:
        return with_latency(images, latency_s, on_invalid=on_invalid)
    _refuse_exchanged(images, trackers)
    return join_several(images, trackers, latency_s, on_invalid=on_invalid)


def _read(found: Format, path: Path, told: Mapping[str, Any]) -> Recording:
    """The recording in a file, whose format is told what it asks for."""
    if found is image_folder.FORMAT:
        _refuse_folder_of_recordings(path)
    recording: Recording = found.read(path, **{name: told[name] for name in found.options if told[name]})
    return recording


def _refuse_folder_of_recordings(folder: Path) -> None:
    """Refuse a folder without images that holds recordings, by their names: its files are meant, one at a time."""
    if any(image_folder.images_in(folder)):
        return
    suffixes = {suffix for one in FORMATS for suffix in one.suffixes} - set(TABLE_SUFFIXES)
    if names := [path.name for path in sorted(folder.iterdir()) if path.suffix.lower() in suffixes]:
        raise InputError(
            f"{folder.resolve().name}: is a folder without images; name a recording in it: {', '.join(names)[:200]}"
        )


def _files(poses: str | Path | Sequence[str | Path]) -> list[Path]:
    """The files of poses, each of which must be one."""
    files = [*map(path_of, [poses] if isinstance(poses, (str, Path)) else poses)]
    for file in files:
        if file.is_dir() and not rosbag.is_bag_folder(file):
            raise InputError(f"{file}: is a directory; name the table of poses in it")
    return files


def _refuse_unused(told: Mapping[str, Any], formats: Sequence[Format], files: Sequence[Path]) -> None:
    """Refuse what is told of a recording and would mean nothing to any of its files."""
    words = {"angles": "three angles for a pose", "markers": "markers in place of poses"}
    for name, value in told.items():
        if value and not any(name in one.options for one in formats):
            raise InputError(
                f"{', '.join(file.name for file in files)}: cannot hold {words[name]}; leave {name} out"
            )


def _refuse_exchanged(images: Recording, trackers: Sequence[Recording]) -> None:
    """Refuse files of poses without poses: most often the recording and its poses stand in each other's place."""
    for tracker in trackers:
        if tracker.poses:
            continue
        if images.image is None and tracker.image is not None:
            raise InputError(
                f"{tracker.name}, given for its poses, holds images and no poses, and {images.name} poses and no "
                "images; exchange the two"
            )
        raise InputError(
            f"{tracker.name}: is given for its poses and holds none; name the tracker's recording"
        )


def write_recording(recording: Recording, path: str | Path, compress: bool = True) -> None:
    """Write a recording, in the format that its name says.

    ``.mha`` and ``.mhd`` are a PLUS sequence metafile, ``.nrrd`` a PLUS NRRD sequence; ``.csv`` a table of the poses of
    a tracker alone; ``.mkv`` a video without loss, with the table of poses beside it.

    Raises:
        UnsupportedError: the name ends otherwise.
    """
    require("recording", recording, Recording)
    path = path_of(path)
    for one in FORMATS:
        if one.write is not None and path.suffix.lower() in one.writes:
            one.write(recording, path, compress)
            return
    *most, last = (suffix for one in FORMATS for suffix in one.writes)
    raise UnsupportedError(
        f"{path}: recordings are written as {', '.join(most)} or {last}; choose one of these names"
    )


def files_written(path: Path) -> tuple[Path, ...]:
    """The files that `write_recording` may write where it is told to write one."""
    beside = {".mhd": (".zraw", ".raw"), ".mkv": (".csv",)}.get(path.suffix.lower(), ())
    return (path, *(path.with_suffix(suffix) for suffix in beside))


def refuse_table(head: Head) -> None:
    """Raise if a file that no format claims is a table of which only the first line is wrong.

    Raises:
        FormatError: it has no header, or blanks between its columns, or is a part of a matrix.
    """
    if head.lacks_header and (part := PARTS_OF_MATRICES.get(_numbers_in_rows(head))):
        raise FormatError(f"{head.path.name}: holds {part}")
    if head.lacks_header:
        raise FormatError(
            f"{head.path.name}, line 1: holds {len(head.words)} numbers where a header must name the columns; put it "
            f"above them, such as {pose_csv.example_header(len(head.words))}, in the order that your columns have"
        )
    if len(head.columns) == 1 and any(map(pose_csv.is_pose_column, head.words)):
        raise FormatError(
            f"{head.path.name}, line 1: has blanks between its columns; write commas, semicolons or tabs there"
        )


# What has no name of a column and is no table, by how many numbers its rows have.
PARTS_OF_MATRICES: dict[tuple[int, ...], str] = {
    (4,) * 3: "3 rows of 4 numbers, a 4 x 4 matrix without its last row; add the row 0 0 0 1",
    (3,) * 3: (
        "3 rows of 3 numbers, a rotation without a place; write 4 rows of 4 numbers, of which the last column is the "
        "place in mm and the last row 0 0 0 1"
    ),
}


def _numbers_in_rows(head: Head) -> tuple[int, ...]:
    """How many words each row of a short file has; three at most are told."""
    rows = [row.decode("utf-8", "replace") for row in head.text.splitlines() if row.strip()]
    rows = [row for row in rows if not row.lstrip().startswith("#")]
    return tuple(len(re.findall(r"[^\s,;|]+", row)) for row in rows) if len(rows) == 3 else ()


def _recognised(path: Path) -> Format:
    head = Head.of(path)
    if not path.is_dir() and not head.content.strip():
        raise InputError(f"{path.name}: is empty; record it again")
    found = recognise(head, FORMATS)
    if found is None:
        refuse_container(head)
    if found is None or not found.sniff(head):  # else it is one, whatever else it might pass for
        refuse_other_kind(path, "recording")
        refuse_table(head)
    if found is None:
        raise UnsupportedError(
            f"{path.name}: is {head.looks_like} and not a recording that sonocal reads; it reads "
            f"{suffixes_of(FORMATS)}, or a folder of images"
        )
    return found


def _poses_beside(path: Path, found: Format) -> list[Path]:
    if found is image_folder.FORMAT:
        tables = [p for p in sorted(path.glob("*.csv")) if p.name != image_folder.STAMPS]
        if len(tables) > 1:
            names = ", ".join(p.name for p in tables)
            raise InputError(f"{path.resolve().name}: holds several tables ({names}); name the poses' one")
        return tables
    table = path.with_suffix(".csv")
    return [table] if found is video.FORMAT and table.is_file() else []
