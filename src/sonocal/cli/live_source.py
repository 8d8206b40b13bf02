"""Where ``sonocal live`` has images and poses from: a server, or devices that are served to it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

import click

__all__ = ["CONNECT", "TOOLS", "TRACKER", "VIDEO", "Source", "source_of"]

CONNECT = click.option(
    "--connect",
    metavar="HOST[:PORT]",
    help="Where a server listens; port 18944 unless said.",
)
TRACKER = click.option(
    "--tracker",
    metavar="DEVICE",
    help="A tracker without a server: optitrack[:HOST] (Motive), optitrack-multicast[:HOST], or ndi:ADDRESS, such as "
    "ndi:192.168.0.10 or ndi:/dev/ttyUSB0.",
)
VIDEO = click.option(
    "--video",
    metavar="DEVICE",
    help="Its images: a frame grabber such as /dev/video0 or 'video=USB Capture', or a file.",
)
TOOLS = click.option(
    "--tool",
    "tools",
    multiple=True,
    metavar="NAME=FILE",
    help="A tool of an NDI tracker: its .rom, or the number of its port; may be given several times.",
)


@dataclass(frozen=True)
class Source:
    """Where to connect, and what feeds it while a session runs; told why where that ends."""

    host: str
    port: int
    feeding: Callable[[Callable[[str], object]], AbstractContextManager[Any]]


@contextmanager
def source_of(
    connect: str | None, tracker: str | None, tools: tuple[str, ...], video: str | None
) -> Iterator[Source]:
    """A server's address, or that of one which serves the devices until this ends."""
    from sonocal import igtl

    if connect is not None:
        if tracker or video or tools:
            raise click.UsageError(
                "--connect is for a server; --tracker, --tool and --video are for devices without one"
            )
        host, port = igtl.address(connect)
        yield Source(host, port, lambda ended: nullcontext())
        return
    if not (tracker and video):
        raise click.UsageError(
            "give --connect HOST[:PORT] of a server, or --tracker and --video of devices without one"
        )
    from sonocal.devices import open_tracker, open_video, relaying

    named = dict(_named(one) for one in tools)
    with ExitStack() as stack:
        poses = open_tracker(tracker, named)
        stack.enter_context(poses)
        images = stack.enter_context(open_video(video))
        server = stack.enter_context(igtl.Server())
        yield Source(server.host, server.port, lambda ended: relaying(server, poses, images, ended))


def _named(text: str) -> tuple[str, str]:
    name, equals, file = text.partition("=")
    if not (name.strip() and equals and file.strip()):
        raise click.UsageError(f"--tool must be NAME=FILE, such as Probe=probe.rom or Probe=0; got {text!r}")
    return name.strip(), file.strip()
