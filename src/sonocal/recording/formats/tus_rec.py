"""Scans of the TUS-REC challenge (``.h5``): ``frames`` (N, V, U) and ``tforms`` (N, 4, 4), mm.

The transforms lead from the tool on the probe to the optical tracker; the frames have no times.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from sonocal.errors import FormatError, InputError, UnsupportedError
from sonocal.files.hdf5 import Damaged, Dataset, Filtered, Item, open_hdf5
from sonocal.files.kinds import Format, Head
from sonocal.recording.formats.parts.layout import COUNT_LIMIT
from sonocal.recording.frames import PICTURE_LIMIT, Frames, Image, check_frame_size
from sonocal.recording.model import ImageGeometry, Provenance, Recording
from sonocal.recording.poses import Poses, by_name

__all__ = ["FORMAT", "read_tus_rec"]

FRAMES, TRANSFORMS = "frames", "tforms"
LARGEST_EXPANSION = 1032  # of deflate


def read_tus_rec(path: Path) -> Recording:
    """Read a scan; its frames are read when asked for.

    Raises:
        FormatError: the file is damaged, stored in a way that is not read, or names data outside of itself.
        InputError: a dataset lacks, or the two do not fit.
        UnsupportedError: pixels are of a kind that is not read, or went through a filter that is not.
    """
    with _guarded(path):
        members = open_hdf5(path).members()
        frames = ScanFrames(path, _dataset(path.name, members, FRAMES))
        transforms = _dataset(path.name, members, TRANSFORMS)
        if transforms.shape != (len(frames), 4, 4) or transforms.dtype.kind != "f":
            raise InputError(
                f"{path.name}: {TRANSFORMS} has shape {transforms.shape} {transforms.dtype.name} for {len(frames)} "
                f"{FRAMES}; one 4 x 4 matrix a frame is needed"
            )
        matrices = transforms.all().astype(float)
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

    def __init__(self, path: Path, dataset: Dataset) -> None:
        if len(dataset.shape) != 3 or dataset.dtype.name not in ("uint8", "uint16"):
            raise UnsupportedError(
                f"{path.name}: {FRAMES} has shape {dataset.shape} {dataset.dtype.name}; grey images (N, V, U) of uint8 "
                "are read"
            )
        if not 1 <= dataset.shape[0] <= COUNT_LIMIT or 0 in dataset.shape:
            raise InputError(f"{path.name}: {FRAMES} has shape {dataset.shape}, which is no scan")
        self._path, self._dataset = path, dataset
        self.shape, self.dtype = dataset.shape[1:], dataset.dtype.newbyteorder("=")
        check_frame_size(path.name, self.shape, self.dtype, PICTURE_LIMIT)

    def __len__(self) -> int:
        return self._dataset.shape[0]

    def read(self, index: int) -> Image:
        """Frame `index`."""
        with _guarded(self._path):
            image = np.asarray(self._dataset.rows(index, index + 1)[0])
        image.flags.writeable = False
        return image


@contextmanager
def _guarded(path: Path) -> Iterator[None]:
    try:
        yield
    except Filtered as error:
        raise UnsupportedError(
            f"{path.name}: its numbers went through {error}, which is not read; save it with gzip, or uncompressed"
        ) from None
    except Damaged as error:
        raise FormatError(
            f"{path.name}: cannot be read as HDF5 ({error}); copy it again, or write it anew with h5repack"
        ) from None


def _dataset(name: str, members: dict[str, Item], key: str) -> Dataset:
    """A dataset that lies in the file itself, and is no larger than what the file could hold."""
    item = members.get(key)
    if item is None or not item.is_dataset:
        there = ", ".join(sorted(members))[:120] or "nothing"
        raise InputError(
            f"{name}: has no dataset {key!r} of its own; it holds {there}, and a scan {FRAMES} and {TRANSFORMS}"
        )
    if item.is_elsewhere:
        raise FormatError(f"{name}: {key} lies in other files; copy it into one")
    found = item.dataset()
    if found.slab_bytes > PICTURE_LIMIT:
        raise UnsupportedError(
            f"{name}: {key} is stored in pieces of more than {PICTURE_LIMIT} bytes; store it a frame a piece"
        )
    # Before memory is asked for.
    if not found.is_whole or found.size > found.stored * LARGEST_EXPANSION:
        raise FormatError(
            f"{name}: {key} states {found.size} bytes and holds {found.stored}; it was cut short, copy it again"
        )
    return found


def _sniff(head: Head) -> bool:
    # Other programs keep other things in such files: transforms of ITK, for one.
    return {FRAMES, TRANSFORMS} <= head.hdf5_names


FORMAT = Format(
    name="TUS-REC scan",
    kind="recording",
    suffixes=(".h5",),
    sniff=_sniff,
    read=read_tus_rec,
    holds="`frames` (N, V, U) and `tforms` (N, 4, 4): probe to tracker; no times",
)
