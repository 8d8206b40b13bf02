"""Images of a frame grabber, a camera or a video file, through PyAV."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError, UnsupportedError
from sonocal.files.closing import Closing
from sonocal.geometry.shown import quoted

__all__ = ["Video"]


class Video(Closing):
    """Grey images one after the other, with the time at which each arrived.

    Args:
        source: a file, or a device such as "/dev/video0" or "video=USB Capture".
        form: FFmpeg's name of the kind of device: "v4l2", "dshow", "avfoundation"; None: a file, or as FFmpeg guesses.
        options: of FFmpeg, such as {"video_size": "1280x720", "framerate": "30"}.
        paced: play a file at its own rate, as a device would give it.

    Raises:
        UnsupportedError: PyAV is not installed.
        InputError: there is no such source, or it has no images.
    """

    def __init__(
        self,
        source: str | Path,
        form: str | None = None,
        options: dict[str, str] | None = None,
        *,
        paced: bool = True,
    ) -> None:
        try:
            import av
        except ImportError:
            raise UnsupportedError("images of video devices need PyAV; pip install av") from None
        self._error: Any = av.error.FFmpegError
        self._source, self._paced = str(source), paced and form is None
        try:
            self._container: Any = av.open(self._source, format=form, options=options or {})
        except (self._error, ValueError, OSError) as error:
            raise InputError(
                f"{self._source}: cannot be opened as a video ({quoted(error, 120)}); see that it is there, and "
                "that no other program has it"
            ) from error
        if not self._container.streams.video:
            self.close()
            raise InputError(f"{self._source}: has no images; name a video, or a device that gives one")

    def __repr__(self) -> str:
        return f"<Video {quoted(self._source)}>"

    def __iter__(self) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """Times in seconds since 1970, and images (rows, columns).

        Raises:
            InputError: the source is damaged, or gone.
        """
        begin_s, first_s = time.time(), None
        try:
            for frame in self._container.decode(video=0):
                if self._paced and frame.time is not None:
                    first_s = frame.time if first_s is None else first_s
                    time.sleep(max(0.0, begin_s + frame.time - first_s - time.time()))
                yield time.time(), np.ascontiguousarray(frame.to_ndarray(format="gray"))
        except (self._error, OSError) as error:
            raise InputError(
                f"{self._source}: gives no images any more ({quoted(error, 120)}); see the cable, and begin again"
            ) from error

    def close(self) -> None:
        """Let the source go."""
        self._container.close()
