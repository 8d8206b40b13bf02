"""Scans of the TUS-REC challenge (``.h5``): ``frames`` (N, V, U) and ``tforms`` (N, 4, 4), mm, by h5py.

The transforms lead from the tool on the probe to the optical tracker; the frames have no times.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, InputError, SonocalError, UnsupportedError
from sonocal.files import file_size
from sonocal.files.kinds import Format, Head
from sonocal.recording.formats.parts.layout import COUNT_LIMIT
from sonocal.recording.formats.parts.packages import needed
from sonocal.recording.frames import PICTURE_LIMIT, Frames, Image, check_frame_size
from sonocal.recording.model import ImageGeometry, Provenance, Recording
from sonocal.recording.poses import Poses, by_name

__all__ = ["FORMAT", "read_tus_rec"]

FRAMES, TRANSFORMS = "frames", "tforms"
START = b"\x89HDF\r\n\x1a\n"
LARGEST_EXPANSION = 1032  # of deflate
BLOCK = 1 << 16


def read_tus_rec(path: Path) -> Recording:
    """Read a scan; its frames are read when asked for.

    Raises:
        FormatError: the file is damaged, or names data outside of itself.
        InputError: a dataset lacks, or the two do not fit.
        UnsupportedError: h5py is not installed, or pixels are of a kind that is not read.
    """
    with _opened(path) as file:
        frames = ScanFrames(path, _dataset(path.name, file, FRAMES))
        transforms = _dataset(path.name, file, TRANSFORMS)
        if transforms.shape != (len(frames), 4, 4) or transforms.dtype.kind != "f":
            raise InputError(
                f"{path.name}: {TRANSFORMS} has shape {transforms.shape} {transforms.dtype} for {len(frames)} "
                f"{FRAMES}; one 4 x 4 matrix a frame is needed"
            )
        matrices = transforms[...].astype(float)
    return Recording(
        times=np.full(len(frames), np.nan),
        frames=frames,
        poses=by_name([Poses.of("Probe", "Tracker", matrices)], path.name),
        image=ImageGeometry.of(frames),
        provenance=Provenance(path.name, "TUS-REC scan", (str(path),)),
    )


class ScanFrames(Frames):
    """The images of a scan.

    Args:
        path: of the file.
        dataset: its images, (N, V, U).
    """

    def __init__(self, path: Path, dataset: Any) -> None:
        if dataset.ndim != 3 or dataset.dtype not in (np.uint8, np.uint16):
            raise UnsupportedError(
                f"{path.name}: {FRAMES} has shape {dataset.shape} {dataset.dtype}; grey images (N, V, U) of uint8 "
                "are read"
            )
        if not 1 <= len(dataset) <= COUNT_LIMIT or 0 in dataset.shape:
            raise InputError(f"{path.name}: {FRAMES} has shape {dataset.shape}, which is no scan")
        self._path, self._count = path, len(dataset)
        self.shape, self.dtype = dataset.shape[1:], dataset.dtype.newbyteorder("=")
        check_frame_size(path.name, self.shape, self.dtype, PICTURE_LIMIT)

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Image]:
        with _opened(self._path) as file:
            dataset = _dataset(self._path.name, file, FRAMES)
            for index in range(self._count):
                yield self._frame(dataset, index)

    def read(self, index: int) -> Image:
        """Frame `index`."""
        with _opened(self._path) as file:
            return self._frame(_dataset(self._path.name, file, FRAMES), index)

    def _frame(self, dataset: Any, index: int) -> Image:
        with _guarded(self._path):
            image = np.asarray(dataset[index]).astype(self.dtype, copy=False)
        if image.shape != self.shape:
            raise FormatError(f"{self._path.name}, frame {index}: changed while it was read")
        image.flags.writeable = False
        return image


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    file_size(path)
    h5py = needed("h5py", path, "HDF5 needs h5py")
    with _guarded(path):
        file = h5py.File(path, "r", locking=False)
    with file:
        yield file


@contextmanager
def _guarded(path: Path) -> Iterator[None]:
    try:
        yield
    except SonocalError:
        raise
    except Exception as error:  # h5py raises many kinds for damaged files
        raise FormatError(
            f"{path.name}: cannot be read as HDF5 ({' '.join(str(error).split())[:80]}); copy it again"
        ) from None


def _dataset(name: str, file: Any, key: str) -> Any:
    """A dataset that lies in the file itself, and is no larger than what the file could hold."""
    import h5py

    with _guarded(Path(name)):
        there = sorted(map(str, file))
        found = file[key] if key in there and isinstance(file.get(key, getlink=True), h5py.HardLink) else None
        if not isinstance(found, h5py.Dataset):
            raise InputError(
                f"{name}: has no dataset {key!r} of its own; it holds {', '.join(there)[:120] or 'nothing'}, and a "
                f"scan {FRAMES} and {TRANSFORMS}"
            )
        if found.external or found.is_virtual:
            raise FormatError(f"{name}: {key} lies in other files; copy it into one")
        _check_stored(name, key, found)
    return found


def _check_stored(name: str, key: str, dataset: Any) -> None:
    """Refuse what is stated and not stored, before memory is asked for."""
    stored, compressed = dataset.id.get_storage_size(), dataset.compression is not None
    if dataset.nbytes > stored * (LARGEST_EXPANSION if compressed else 1) + BLOCK * compressed:
        raise FormatError(
            f"{name}: {key} states {dataset.nbytes} bytes and holds {stored}; it was cut short, copy it again"
        )
    if dataset.chunks and dataset.dtype.itemsize * int(np.prod(dataset.chunks, dtype=object)) > PICTURE_LIMIT:
        raise UnsupportedError(
            f"{name}: {key} is stored in pieces of more than {PICTURE_LIMIT} bytes; store it a frame a piece"
        )


def _sniff(head: Head) -> bool:
    # Other programs keep other things in such files: transforms of ITK, for one.
    return (
        head.content.startswith(START)
        and FRAMES.encode() in head.content
        and TRANSFORMS.encode() in head.content
    )


FORMAT = Format(
    name="TUS-REC scan",
    kind="recording",
    suffixes=(".h5",),
    sniff=_sniff,
    read=read_tus_rec,
    holds="`frames` (N, V, U) and `tforms` (N, 4, 4): probe to tracker; no times",
    needs=("h5py",),
)
