"""The scan that ``sonocal studio --live`` follows: the session of ``sonocal live``, and the recording it leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sonocal.cli.live_begin import IMAGES, RECORDING, as_recorded, keep_in, session_of
from sonocal.cli.options import typed
from sonocal.cli.reading import ESTIMATE
from sonocal.cli.studio_work import Openings
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.studio import Begin, Feed
    from sonocal.studio.work import Work

__all__ = ["scan_to_follow"]


def scan_to_follow(
    server: str, lines: Path, output: Path, options: dict[str, Any], reading: Sequence[str]
) -> Begin:
    """Begins a session with what a server sends.

    Args:
        server: as HOST or HOST:PORT.
        lines: the needle or wires.
        output: folder of the recording.
        options: of the command.
        reading: further arguments of ``sonocal calibrate``.

    Raises:
        InputError: the folder holds a recording, or the address is none.
        UnsupportedError: there are other targets than needles and wires.
    """
    from sonocal import igtl

    host, port = igtl.address(server)
    if not typed(("on_invalid",)):
        options["on_invalid"] = "skip"
    for name in (RECORDING, IMAGES):
        if (output / name).exists():
            raise InputError(
                f"{output / name}: is of an earlier scan, and stays; look at it with sonocal studio "
                f"{output / RECORDING} --lines {lines}, or choose another folder with -o"
            )
    session = session_of(lines, options)
    told_s = 0.0 if options["latency_s"] == ESTIMATE else options["latency_s"]

    def begin() -> tuple[Feed, Callable[[], Work]]:
        from sonocal.live import GREETING, Guide, Live, Pairing
        from sonocal.studio import Feed
        from sonocal.sweep import Reach

        with ExitStack() as stack:
            client = stack.enter_context(igtl.Client(host, port, greeting=GREETING))
            keep_in(session, output)
            stack.callback(session.close)
            until_mm = options["until_mm"]
            running = Live(
                client,
                session,
                pairing=Pairing(options["image"], told_s),
                until_mm=until_mm,
                advice=Guide(session, Reach(most_tilt_deg=options["most_tilt_deg"])),
            )
            feed = Feed(running, f"{host}:{port}", until_mm=until_mm, close=stack.pop_all().close)

        def recorded() -> Work:
            if not (output / RECORDING).exists():
                raise InputError(
                    f"{host}:{port}: no image came, so nothing was recorded; start the command again"
                )
            openings = Openings(output, [*reading, *as_recorded(running, options)])
            return openings.open(output / RECORDING, lines)

        return feed, recorded

    return begin
