"""``sonocal replay``: a recording that is served as PLUS would."""

from __future__ import annotations

from pathlib import Path
from threading import Event
from typing import Any

import click

from sonocal.cli.help import command
from sonocal.cli.options import ANGLES, FILE, INVALID, MARKERS, POSES, seed
from sonocal.cli.reading import read_given
from sonocal.cli.screen.plain import say

__all__ = ["replay"]

PORT = 18944
LAST_S = 10.0
SHARE = click.FloatRange(0, 1, max_open=True)


@command(
    "Serve a recording over OpenIGTLink, as PLUS would.",
    groups={
        "What is read": ("poses", "angles", "markers", "on_invalid"),
        "How it is sent": ("rate_hz", "apart", "loop"),
        "What goes wrong on purpose": ("invalid", "gaps", "reordered", "say_invalid", "seed"),
        "Where it listens": ("host", "port"),
    },
    examples=(
        "sonocal replay sweep.igs.mha",
        "sonocal replay sweep.igs.mha --port 18945 --rate 30 --loop",
        "sonocal replay sweep.igs.mha --invalid 0.1 --gaps 0.02 --reordered 0.2",
    ),
)
@click.argument("recording", type=FILE)
@POSES
@ANGLES
@MARKERS
@INVALID
@click.option(
    "--rate",
    "rate_hz",
    type=click.FloatRange(0, 10000, min_open=True),
    metavar="HZ",
    help="Items a second.  [default: as recorded]",
)
@click.option(
    "--apart",
    is_flag=True,
    help="Send poses as streams of their own, with stamps between those of the images.",
)
@click.option("--loop", is_flag=True, help="Begin again at the end, until somebody interrupts.")
@click.option(
    "--invalid", type=SHARE, default=0.0, metavar="SHARE", help="Of poses that are lost.  [default: none]"
)
@click.option(
    "--gaps",
    type=SHARE,
    default=0.0,
    metavar="SHARE",
    help="Of items that are not sent at all.  [default: none]",
)
@click.option(
    "--reordered",
    type=SHARE,
    default=0.0,
    metavar="SHARE",
    help="Of messages that change places with the next one.  [default: none]",
)
@click.option(
    "--say-invalid",
    is_flag=True,
    help="Send lost poses with the status INVALID; else they are absent, as is PLUS's default.",
)
@seed("what goes wrong")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on: this machine alone; 0.0.0.0 lets everybody on the network watch.",
)
@click.option(
    "--port", type=click.IntRange(0, 65535), default=PORT, show_default=True, help="0: one that is free."
)
def replay(
    recording: Path,
    *,
    rate_hz: float | None,
    apart: bool,
    loop: bool,
    host: str,
    port: int,
    invalid: float,
    gaps: float,
    reordered: float,
    say_invalid: bool,
    seed: int,
    **options: Any,
) -> None:
    """Serve a recording (RECORDING, any that sonocal reads) over OpenIGTLink, as PLUS serves what it acquires.

    It begins when the first client connects, and ends with the recording; images and poses of one item share a stamp.
    Whoever connects is spoken to in version 1 of the protocol, and in version 2 once it sent a message of that.

    A counterpart for "sonocal live", 3D Slicer (OpenIGTLinkIF, client) and programs of your own, with no machine beside
    you: and what real trackers and networks do can be had on demand.
    """
    from sonocal import igtl
    from sonocal.live import Faults, Replay

    loaded = read_given(recording, {"probe": "Probe", "latency_s": 0.0} | options)
    faults = Faults(invalid, gaps, reordered, say_invalid, seed)
    played = Replay(loaded, faults, apart=apart)
    with igtl.Server(host, port) as server:
        serve(played, server, rate_hz=rate_hz, loop=loop)


def serve(played: Any, server: Any, *, rate_hz: float | None, loop: bool) -> None:
    """Send a recording, and say so; until its end, or until somebody interrupts."""
    who = "this machine alone" if server.host in ("127.0.0.1", "localhost", "::1") else "the network"
    what = played.recording
    say(
        f"Serves {len(what)} items of {what.name} on {server.host}:{server.port}, to {who}; waits for the first client "
        f'("sonocal live --connect localhost:{server.port} --lines needle.toml"), ctrl-C ends'
    )
    try:
        sent = played.run(server, Event(), rate_hz=rate_hz, loop=loop)
        server.flush(LAST_S)
        say(f"Sent {sent} items")
    except KeyboardInterrupt:
        say("Interrupted")
    for note in server.notes:
        say(f"Note: {note}", err=True)
