"""Any recording that sonocal reads, by what is in the file rather than by its name."""

from __future__ import annotations

import re
from pathlib import Path

from sonocal.errors import InputError, UnsupportedError
from sonocal.files import read_at
from sonocal.recording.formats.dicom import read_dicom
from sonocal.recording.formats.image_folder import (
    STAMPS,
    is_image,
    read_image_file,
    read_image_folder,
)
from sonocal.recording.formats.metaio import read_metaio
from sonocal.recording.formats.metaio_write import write_metaio
from sonocal.recording.formats.nrrd import read_nrrd
from sonocal.recording.formats.nrrd_write import write_nrrd
from sonocal.recording.formats.pose_csv import read_pose_csv
from sonocal.recording.formats.video import read_video
from sonocal.recording.model import Recording
from sonocal.recording.poses import OnInvalid
from sonocal.recording.timing import join, with_latency

__all__ = ["read_recording", "write_recording"]

HEAD = 4096
KNOWN = ".mha, .mhd, .nrrd, .nhdr, .csv, .mp4, .dcm, .png, or a folder of images"


def read_recording(
    path: str | Path,
    poses: str | Path | None = None,
    latency_s: float = 0.0,
    on_invalid: OnInvalid = "raise",
) -> Recording:
    """Read a recording of any format.

    A video or folder of images is joined by time stamp with its tracker's poses: those of `poses`, or else
    the ``.csv`` of the same name beside the video, or the one table of poses in the folder.

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
    images = read_image_folder(path) if path.is_dir() else _read_file(path)
    tracker = Path(poses) if poses is not None else _poses_beside(path)
    if tracker is None:
        return with_latency(images, latency_s, on_invalid=on_invalid)
    return join(images, _read_file(tracker), latency_s, on_invalid=on_invalid)


def write_recording(recording: Recording, path: str | Path, compress: bool = True) -> None:
    """Write a recording: ``.mha`` and ``.mhd`` as a PLUS sequence metafile, ``.nrrd`` as a PLUS NRRD sequence.

    Raises:
        UnsupportedError: the name ends otherwise.
    """
    suffix = Path(path).suffix.lower()
    if suffix in (".mha", ".mhd"):
        write_metaio(recording, path, compress)
    elif suffix == ".nrrd":
        write_nrrd(recording, path, compress)
    else:
        raise UnsupportedError(
            f"{path}: recordings are written as .mha, .mhd or .nrrd; choose one of these names"
        )


def _read_file(path: Path) -> Recording:
    head = read_at(path, 0, HEAD)
    if not head.strip():
        raise InputError(f"{path.name}: is empty; record it again")
    if head.startswith(b"NRRD"):
        return read_nrrd(path)
    if head[128:132] == b"DICM":
        return read_dicom(path)
    if head[4:8] == b"ftyp" or head.startswith((b"\x1a\x45\xdf\xa3", b"RIFF")):
        return read_video(path)
    if is_image(head):
        return read_image_file(path)
    return _read_text_file(path, head)


def _read_text_file(path: Path, head: bytes) -> Recording:
    start = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if start.startswith(b"<"):
        raise UnsupportedError(
            f"{path.name}: is XML, not a recording; a PLUS device set is given with --lines"
        )
    if path.suffix.lower() in (".mha", ".mhd") or re.match(rb"\w+[ \t]*=", start):
        return read_metaio(path)
    if path.suffix.lower() in (".csv", ".txt") or start.startswith(b"Format Version"):
        return read_pose_csv(path)
    raise UnsupportedError(f"{path.name}: is not a recording that sonocal reads; it reads {KNOWN}")


def _poses_beside(path: Path) -> Path | None:
    if path.is_dir():
        tables = [p for p in sorted(path.glob("*.csv")) if p.name != STAMPS]
        if len(tables) > 1:
            names = ", ".join(p.name for p in tables)
            raise InputError(f"{path.resolve().name}: holds several tables ({names}); name the poses' one")
        return tables[0] if tables else None
    table = path.with_suffix(".csv")
    video = path.suffix.lower() in (".mp4", ".mkv", ".avi", ".mov")
    return table if video and table.is_file() else None
