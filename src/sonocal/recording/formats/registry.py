"""Any recording that sonocal reads or writes: the list of formats, and the two functions that choose from it.

A new format is a file beside this one that ends with its `FORMAT`, and a line in `FORMATS`.
"""

from __future__ import annotations

from pathlib import Path

from sonocal.errors import InputError, UnsupportedError
from sonocal.files.kinds import Format, Head, recognise, suffixes_of
from sonocal.recording.formats import (
    dicom,
    image,
    image_folder,
    kretz,
    metaio,
    motive,
    nrrd,
    pose_csv,
    rosbag,
    slicer_scene,
    tus_rec,
    video,
)
from sonocal.recording.model import Recording
from sonocal.recording.poses import OnInvalid
from sonocal.recording.timing import join, with_latency

__all__ = ["FORMATS", "files_written", "read_recording", "write_recording"]

# In the order of the documentation. What no format claims by its content goes to the first that its name fits.
FORMATS: tuple[Format, ...] = (
    metaio.FORMAT,
    nrrd.FORMAT,
    slicer_scene.FORMAT,
    pose_csv.FORMAT,
    motive.FORMAT,
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
    poses: str | Path | None = None,
    latency_s: float = 0.0,
    on_invalid: OnInvalid = "raise",
) -> Recording:
    """Read a recording of any format.

    A video or folder of images without poses is joined by time stamp with its tracker's: those of `poses`, or
    else the ``.csv`` of the same name beside the video, or the one table of poses in the folder.

    Args:
        path: the file, or the folder of images.
        poses: the tracker's own recording, where it is another file.
        latency_s: how much later the tracker stamps an instant than the images do; poses are moved by it.
        on_invalid: what to do with poses marked valid that are not rigid, where poses are moved or joined.

    Raises:
        InputError: it cannot be read; the sentence says what, where and the remedy.
        UnsupportedError: it is a kind of file that sonocal does not read.
    """
    path = Path(path)
    found = _recognised(path)
    images: Recording = found.read(path)
    tracker = Path(poses) if poses is not None else None if images.poses else _poses_beside(path, found)
    if tracker is None:
        return with_latency(images, latency_s, on_invalid=on_invalid)
    if tracker.is_dir() and not rosbag.is_bag_folder(tracker):
        raise InputError(f"{tracker}: is a directory; name the table of poses in it")
    return join(images, _recognised(tracker).read(tracker), latency_s, on_invalid=on_invalid)


def write_recording(recording: Recording, path: str | Path, compress: bool = True) -> None:
    """Write a recording, in the format that its name says.

    ``.mha`` and ``.mhd`` are a PLUS sequence metafile, ``.nrrd`` a PLUS NRRD sequence; ``.csv`` a table of the poses of
    a tracker alone; ``.mkv`` a video without loss, with the table of poses beside it.

    Raises:
        UnsupportedError: the name ends otherwise.
    """
    path = Path(path)
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


def _recognised(path: Path) -> Format:
    head = Head.of(path)
    if not path.is_dir() and not head.content.strip():
        raise InputError(f"{path.name}: is empty; record it again")
    found = recognise(head, FORMATS)
    if found is None and head.text.startswith(b"<"):
        raise UnsupportedError(
            f"{path.name}: is XML, not a recording; a PLUS device set is given with --lines"
        )
    if found is None:
        raise UnsupportedError(
            f"{path.name}: is {head.looks_like} and not a recording that sonocal reads; it reads "
            f"{suffixes_of(FORMATS)}, or a folder of images"
        )
    return found


def _poses_beside(path: Path, found: Format) -> Path | None:
    if found is image_folder.FORMAT:
        tables = [p for p in sorted(path.glob("*.csv")) if p.name != image_folder.STAMPS]
        if len(tables) > 1:
            names = ", ".join(p.name for p in tables)
            raise InputError(f"{path.resolve().name}: holds several tables ({names}); name the poses' one")
        return tables[0] if tables else None
    table = path.with_suffix(".csv")
    return table if found is video.FORMAT and table.is_file() else None
