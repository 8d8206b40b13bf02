"""A tracker and a video as one server of OpenIGTLink: what follows PLUS follows them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from sonocal import igtl
from sonocal.devices.tracker import Tracker
from sonocal.errors import SonocalError

__all__ = ["relay", "relaying"]

READ_S = 0.1


def relay(
    server: igtl.Server,
    tracker: Tracker,
    images: Iterable[tuple[float, NDArray[np.uint8]]],
    stop: threading.Event,
    *,
    frame: str = "Tracker",
) -> None:
    """Serve poses and images until the images end, or it is to stop: `sonocal live --connect` reads them.

    Poses and images have stamps of their own, of this machine's clock when they arrived: a latency between the two is
    for `--latency estimate`. A tool that is lost is not sent, as PLUS does.

    Args:
        server: to which clients connect.
        tracker: that is read in a thread of its own.
        images: times in s since 1970 and pixels (rows, columns), such as a `Video`.
        stop: ends it.
        frame: what poses are in: a tool is sent as ProbeToTracker.

    Raises:
        SonocalError: the tracker or the video failed.
    """
    failed: list[SonocalError] = []

    def follow() -> None:
        try:
            while not stop.is_set():
                if (reading := tracker.read(READ_S)) is None:
                    continue
                for name, pose in reading.poses.items():
                    if pose is not None:
                        stamp = igtl.stamp_of(reading.time_s)
                        server.send(igtl.Message(igtl.Transform(pose), f"{name}To{frame}", stamp))
        except SonocalError as error:  # raised by whoever waits
            failed.append(error)
            stop.set()

    thread = threading.Thread(target=follow, name="reads the tracker", daemon=True)
    thread.start()
    try:
        for time_s, pixels in images:
            if stop.is_set():
                break
            server.send(igtl.Message(igtl.Image.of(pixels), "Image", igtl.stamp_of(time_s)))
    finally:
        stop.set()
        thread.join()
    if failed:
        raise failed[0]


@contextmanager
def relaying(
    server: igtl.Server,
    tracker: Tracker,
    images: Iterable[tuple[float, NDArray[np.uint8]]],
    ended: Callable[[str], object],
) -> Iterator[None]:
    """Serve them beside what is done inside, from the first client on, in a thread that has ended behind it.

    Args:
        server: to which clients connect.
        tracker: that is read in a thread of its own.
        images: as of `relay`.
        ended: told why, from that thread, where the images end or a device fails before the inside does.
    """
    stop = threading.Event()

    def run() -> None:
        why = "the images ended"
        while not stop.is_set() and not server.wait_for_peer(READ_S):
            pass
        try:
            relay(server, tracker, images, stop)
        except SonocalError as error:
            why = str(error)
        if not asked.is_set():
            ended(why)

    asked = threading.Event()
    thread = threading.Thread(target=run, name="serves a tracker and a video", daemon=True)
    thread.start()
    try:
        yield
    finally:
        asked.set()
        stop.set()
        thread.join()
