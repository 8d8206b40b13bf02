"""Trackers and videos by what one types of them."""

from __future__ import annotations

import re
import socket
import sys
from collections.abc import Mapping
from pathlib import Path

from sonocal.devices.ndi import Ndi
from sonocal.devices.optitrack import COMMAND_PORT, OptiTrack
from sonocal.devices.video import Video
from sonocal.errors import InputError
from sonocal.geometry.shown import quoted

__all__ = ["open_tracker", "open_video"]

LOOPBACK = "127.0.0.1"
KINDS = "optitrack, optitrack:HOST[:PORT], optitrack-multicast:HOST[:PORT] or ndi:ADDRESS"


def open_tracker(text: str, tools: Mapping[str, str] | None = None) -> OptiTrack | Ndi:
    """A tracker, to be closed by whoever asked for it.

    Args:
        text: "optitrack:HOST" (Motive's unicast, "optitrack-multicast:HOST" the other one; this machine where no host
            is said), or "ndi:ADDRESS", of a Vega ("ndi:192.168.0.10") or a serial device ("ndi:/dev/ttyUSB0").
        tools: of NDI: a file (.rom), or the number of a port, from 0, by the tool's name. Motive names its own.

    Raises:
        InputError: it is none of these, nobody answers there, or a tool is not taken.
        UnsupportedError: its package is not installed.
    """
    kind, _, where = text.strip().partition(":")
    tools = dict(tools or {})
    if kind.lower() == "ndi" and where:
        if not tools:
            raise InputError(
                "of an NDI tracker nothing is known of its tools; name each with its file or port, such as "
                "Probe=probe.rom or Probe=0"
            )
        return Ndi({name: int(one) if one.isdecimal() else one for name, one in tools.items()}, where)
    if kind.lower() not in ("optitrack", "optitrack-multicast"):
        raise InputError(f"{quoted(text, 60)} is no tracker that sonocal knows; give {KINDS}")
    if tools:
        raise InputError("Motive names its rigid bodies itself; rename them there, and name no tools here")
    host, _, port = where.partition(":")
    if port and not (port.isascii() and port.isdecimal() and 0 < int(port) < 1 << 16):
        raise InputError(f"a tracker's address must be HOST or HOST:PORT; got {quoted(where, 60)}")
    host, number = host or LOOPBACK, int(port or COMMAND_PORT)
    multicast = kind.lower() == "optitrack-multicast"
    return OptiTrack(host, _own_address(host, number), multicast=multicast, command_port=number)


def open_video(source: str) -> Video:
    """Images of a device or a file, to be closed by whoever asked for them.

    Args:
        source: "/dev/video0", "video=USB Capture" (Windows), the number of a camera (macOS), or a file.

    Raises:
        InputError: there is no such source, or it has no images.
        UnsupportedError: PyAV is not installed.
    """
    return Video(source, _form_of(source))


def _form_of(source: str) -> str | None:
    """FFmpeg's name of the kind of device; None: a file."""
    if source.startswith("/dev/video"):
        return "v4l2"
    if source.startswith("video="):
        return "dshow"
    if re.fullmatch(r"\d+", source) and sys.platform == "darwin" and not Path(source).exists():
        return "avfoundation"
    return None


def _own_address(host: str, port: int) -> str:
    """Of this machine, as another one reaches it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        try:
            one.connect((host, port))  # of UDP: nothing is sent
        except (OSError, UnicodeError) as error:
            raise InputError(
                f"{quoted(host, 60)}: this machine knows no way there; see the tracker's address"
            ) from error
        return str(one.getsockname()[0])
