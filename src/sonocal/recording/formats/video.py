"""Videos (``.mp4``, ``.mkv``, ``.avi``): frames by PyAV, stamped with the video's own clock, s.

Poses are those of text tracks, as PLUS writes them, or of a table beside the video.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError
from sonocal.files import file_size
from sonocal.files.kinds import Format, Head
from sonocal.geometry import Array
from sonocal.recording.formats.parts.packages import needed
from sonocal.recording.formats.parts.pose_tracks import poses_in_tracks
from sonocal.recording.formats.parts.video_write import write_video
from sonocal.recording.frames import PICTURE_LIMIT, Frames, Image, check_frame_size
from sonocal.recording.model import ImageGeometry, Provenance, Recording
from sonocal.recording.poses import Poses

__all__ = ["FORMAT", "read_video"]


def read_video(path: Path) -> Recording:
    """Read a video; only its index is read, frames are decoded when asked for.

    Raises:
        UnsupportedError: PyAV is not installed.
        FormatError: the file is no video, or holds no frames.
    """
    file_size(path)
    frames = VideoFrames(path)
    return Recording(
        times=frames.times,
        frames=frames,
        poses=frames.poses(),
        image=ImageGeometry.of(frames),
        provenance=Provenance(path.name, "video", (str(path),)),
    )


class VideoFrames(Frames):
    """Frames of a video, grey where it is grey, else red, green, blue.

    Attributes:
        times: (N,) s, from the start of the video's clock.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._av = path, _pyav(path)
        self.dtype = np.dtype("u1")
        with self._opened() as container:
            stream = self._stream(container)
            context = stream.codec_context
            self._format = "gray" if (context.pix_fmt or "").startswith("gray") else "rgb24"
            self.shape = (context.height, context.width) + (() if self._format == "gray" else (3,))
            check_frame_size(path.name, self.shape, self.dtype, PICTURE_LIMIT)
            base = float(stream.time_base)
            stamps = sorted(p.pts for p in container.demux(stream) if p.pts is not None and p.size)
        if not stamps or 0 in self.shape:
            raise FormatError(f"{path.name}: holds no frames; record it again")
        self._stamps = stamps
        self.times: Array = np.array(stamps, dtype=float) * base
        self._ahead: tuple[int, Iterator[Image]] | None = None

    def __len__(self) -> int:
        return len(self._stamps)

    def __iter__(self) -> Iterator[Image]:
        return self._decode(0)

    def read(self, index: int) -> Image:
        """Frame `index`; the next one in order costs no search."""
        if self._ahead is None or self._ahead[0] != index:
            self._ahead = (index, self._decode(index))
        frame = next(self._ahead[1], None)
        if frame is None:
            raise FormatError(f"{self._path.name}, frame {index}: cannot be decoded; the video ends early")
        self._ahead = (index + 1, self._ahead[1])
        return frame

    def poses(self) -> dict[str, Poses]:
        """The poses in the video's text tracks at the times of its frames, by name."""
        with self._opened() as container:
            return poses_in_tracks(container, self.times, self._path.name)

    def _decode(self, start: int) -> Iterator[Image]:
        count = start
        with self._opened() as container:
            stream = self._stream(container)
            if start:
                container.seek(self._stamps[start], stream=stream)
            for frame in container.decode(stream):
                if frame.pts is None or frame.pts < self._stamps[start]:
                    continue
                if count == len(self._stamps):
                    return
                if (frame.height, frame.width) != self.shape[:2]:
                    raise FormatError(f"{self._path.name}, frame {count}: changes its size within the video")
                image = frame.to_ndarray(format=self._format)
                image.flags.writeable = False
                yield image
                count += 1

    def _opened(self) -> Any:
        return _Guarded(self._av, self._path)

    def _stream(self, container: Any) -> Any:
        if not container.streams.video:
            raise FormatError(f"{self._path.name}: holds no video stream")
        stream = container.streams.video[0]
        if stream.codec_context is None or stream.time_base is None:
            raise FormatError(
                f"{self._path.name}: its video is of a kind that cannot be decoded; convert it to .mp4"
            )
        # Damaged packets may announce sizes of their own.
        stream.codec_context.options = {"max_pixels": str(PICTURE_LIMIT // 3)}
        return stream


class _Guarded:
    """An open container whose failures become sentences."""

    def __init__(self, av: Any, path: Path) -> None:
        self._av, self._path, self._container = av, path, None

    def __enter__(self) -> Any:
        try:
            self._container = self._av.open(str(self._path))
        except (self._av.error.FFmpegError, ValueError) as error:
            raise self._sentence(error) from None
        return self._container

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if self._container is not None:
            self._container.close()
        if isinstance(error, (self._av.error.FFmpegError, ValueError, OverflowError)):
            raise self._sentence(error) from None

    def _sentence(self, error: Exception) -> FormatError:
        return FormatError(
            f"{self._path.name}: cannot be decoded as video ({str(error)[:80]}); convert it to .mp4"
        )


def _sniff(head: Head) -> bool:
    start = head.content
    riff = start.startswith(b"RIFF") and start[8:12] == b"AVI "
    return riff or start[4:8] == b"ftyp" or start.startswith(b"\x1a\x45\xdf\xa3")


def _pyav(path: Path) -> Any:
    av = needed("av", path, "videos need PyAV")
    av.logging.set_level(None)
    return av


FORMAT = Format(
    name="video",
    kind="recording",
    suffixes=(".mp4", ".mkv", ".avi", ".mov"),
    sniff=_sniff,
    read=read_video,
    holds="poses in text tracks as PLUS writes them, or in the `.csv` of the same name beside it; written without loss "
    "(FFV1)",
    write=write_video,
    writes=(".mkv",),
    needs=("av",),
)
