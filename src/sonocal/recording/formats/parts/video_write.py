"""Writing videos without loss: ``.mkv`` with FFV1, and the table of poses beside it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import InputError
from sonocal.files import writing
from sonocal.recording.formats.parts.packages import needed
from sonocal.recording.formats.parts.pose_csv_write import pose_table
from sonocal.recording.formats.parts.written import pixels_of
from sonocal.recording.frames import no_frames
from sonocal.recording.model import Recording

__all__ = ["write_video"]

# Matroska counts milliseconds, whatever it is asked for.
TICK = Fraction(1, 1000)
# (as NumPy has it, as FFV1 keeps it without loss) by the number of channels
PIXELS = {1: ("gray", "gray"), 3: ("rgb24", "bgr0")}


# Neither dates nor random numbers: the same recording makes the same bytes.
EXACT = {"fflags": "+bitexact"}


def write_video(recording: Recording, path: str | Path, compress: bool = True) -> None:
    """Write images of 8 bits as a video, and poses as the ``.csv`` of the same name, stamped as the video is.

    Frames and poses are read again bit for bit; stamps are rounded to the video's ms. Where there are no poses, no
    table is written.

    Args:
        recording: what to write; fields, and which images are valid, have no place in a video.
        path: ``.mkv``.
        compress: of no meaning here.

    Raises:
        InputError: it has no images of 8 bits, or its stamps are no ms that increase; nothing is left half written.
        UnsupportedError: PyAV is not installed.
    """
    path = Path(path)
    av = needed("av", path, "videos need PyAV")
    _check_images(recording)
    stamps = _stamps(recording)
    table = path.with_suffix(".csv")
    if not recording.poses and table.exists():
        raise InputError(
            f"{table}: would be taken for the poses of {path.name}; delete it, or choose another name"
        )
    with ExitStack() as stack:  # both or neither
        video = stack.enter_context(writing(path))
        if recording.poses:
            times = stamps * float(
                TICK
            )  # to the last digit what is read, or poses would be those between two
            tracker = replace(recording, times=times, frames=no_frames(), image=None)
            stack.enter_context(writing(table)).write(pose_table(tracker))
        _encode(av, video, recording, stamps.tolist())


def _encode(av: Any, file: Any, recording: Recording, stamps: list[int]) -> None:
    assert recording.image is not None
    given, kept = PIXELS[recording.image.channels]
    with _told(av, recording.name), av.open(file, "w", format="matroska", options=EXACT) as container:
        stream = container.add_stream("ffv1", rate=1 / TICK)
        stream.width, stream.height = recording.image.size_px
        stream.pix_fmt, stream.time_base = kept, TICK
        for image, stamp in zip(_images(recording), stamps, strict=True):
            frame = av.VideoFrame.from_ndarray(image, format=given).reformat(format=kept)
            frame.pts, frame.time_base = stamp, TICK
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


@contextmanager
def _told(av: Any, name: str) -> Iterator[None]:
    """Turn the failures of the encoder into a sentence."""
    try:
        yield
    except (av.error.FFmpegError, NotImplementedError, ValueError) as error:
        raise InputError(
            f"{name}: cannot be written as a video ({str(error)[:60]}); choose .mha or .nrrd"
        ) from None


def _images(recording: Recording) -> Iterator[Any]:
    yield from map(np.ascontiguousarray, pixels_of(recording))


def _check_images(recording: Recording) -> None:
    image = recording.image
    if image is None or image.dimension != 2 or image.dtype != "uint8" or image.channels not in PIXELS:
        what = "no images" if image is None else f"{image.dtype} of {' x '.join(map(str, image.size_px))} px"
        raise InputError(
            f"{recording.name}: holds {what}, and a video images of 8 bits, grey or in colour; choose .mha or .nrrd"
        )


def _stamps(recording: Recording) -> Any:
    """(N,) ms."""
    with np.errstate(invalid="ignore", over="ignore"):
        stamps = np.rint(recording.times / float(TICK))
    if not (
        np.isfinite(stamps).all()
        and (stamps >= 0).all()
        and (stamps < 2**53).all()
        and (np.diff(stamps) > 0).all()
    ):
        raise InputError(
            f"{recording.name}: its stamps are no milliseconds from 0 that increase, as a video's are; "
            "choose .mha or .nrrd"
        )
    return stamps.astype(np.int64)
