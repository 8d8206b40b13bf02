"""The server on its socket, and the address to open."""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from sonocal.errors import InputError, UnsupportedError
from sonocal.studio.app import application
from sonocal.studio.bench import Bench
from sonocal.studio.beside import OtherOf
from sonocal.studio.desk import EXPORTED, JOURNAL, Desk
from sonocal.studio.feed import Feed
from sonocal.studio.following import Following
from sonocal.studio.guard import Guard
from sonocal.studio.needle import Asked, ToolOf
from sonocal.studio.uploads import Uploads
from sonocal.studio.work import Opener, Work

__all__ = ["Begin", "serve"]

Begin = Callable[[], tuple[Feed, Callable[[], Work]]]
"""Begins a live session; and opens what it recorded, once it ended."""

LOOPBACK = "127.0.0.1"
EVERYWHERE = ("0.0.0.0", "::")
UPLOADED = "inputs"
OWN = {JOURNAL, EXPORTED, UPLOADED}


def serve(
    folder: Path,
    opener: Opener,
    tool_of: ToolOf,
    other_of: OtherOf,
    first: Sequence[Path] = (),
    *,
    needle: Asked | None = None,
    other: Path | None = None,
    host: str = LOOPBACK,
    port: int = 0,
    begin: Begin | None = None,
    recorded: Sequence[str] = (),
    ready: Callable[[str], Any] = lambda address: None,
) -> None:
    """Serve the page until somebody interrupts.

    Args:
        folder: for the journal and for what is exported.
        opener: opens what the page sends.
        tool_of: finds tools from what the page sends.
        other_of: reads the calibrations to compare with that the page sends.
        first: what is on the desk from the start: a recording and perhaps what is scanned, or a table.
        needle: what the needle is found from, at the start.
        other: a calibration to compare with from the start.
        host: to listen on; another than the loopback lets other machines in, who need the key, too.
        port: 0 for one that is free.
        begin: a live session that the page follows, in place of `first`; it records into `folder`.
        recorded: the names of its files there.
        ready: called with the address to open, which holds the key, when the server listens.

    Raises:
        InputError: the port is taken, the host is none of this machine, or `other` cannot be read.
        UnsupportedError: starlette, uvicorn or websockets is not installed.
    """
    uvicorn = _uvicorn()
    refuse_foreign(folder, recorded)
    with ExitStack() as stack:
        listening = stack.enter_context(closing(_listening(host, port)))
        port = int(listening.getsockname()[1])
        desk = stack.enter_context(closing(Desk(folder)))
        following = None
        if begin is not None:
            following = stack.enter_context(closing(Following(desk, *begin())))
        uploads = Uploads(folder / UPLOADED)
        bench = Bench(desk, uploads, opener, tool_of, other_of, following=following)
        guard = Guard(application(desk, bench, uploads, following), hosts_of(host, port), port)
        for path in first:
            uploads.know(path)
        if other is not None:
            bench.compare(other)
        if first:
            bench.open(first[0], first[1] if first[1:] else None)
        if needle is not None:
            bench.find_aside(needle)
        shown = LOOPBACK if host in EVERYWHERE else host
        named = f"[{shown}]" if ":" in shown else shown
        config = uvicorn.Config(
            guard,
            log_level="warning",
            ws_max_size=1 << 14,
            ws_per_message_deflate=False,
            server_header=False,
            timeout_graceful_shutdown=1,
        )
        ready(f"http://{named}:{port}/?key={guard.key}")
        uvicorn.Server(config).run(sockets=[listening])


def refuse_foreign(folder: Path, recorded: Sequence[str] = ()) -> None:
    """Refuse a folder that holds what no studio wrote.

    Args:
        folder: for the journal and for what is exported.
        recorded: the names of files that a live session keeps there.

    Raises:
        InputError: it does.
    """
    own = OWN.union(recorded)
    if folder.exists() and not (
        folder.is_dir() and ((folder / JOURNAL).exists() or all(one.name in own for one in folder.iterdir()))
    ):
        raise InputError(f"{folder}: holds other files than the studio's; choose another folder with -o")


def hosts_of(host: str, port: int) -> frozenset[str]:
    """What a request's Host may be: the loopback's names, and the one that was asked for."""
    names = {"localhost", LOOPBACK, "[::1]"}
    if host in EVERYWHERE:
        names |= {socket.gethostname().lower(), socket.gethostbyname(socket.gethostname())}
    else:
        names.add(f"[{host}]" if ":" in host else host.lower())
    return frozenset(f"{name}:{port}" for name in names)


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    made = socket.socket(family, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
        made.listen(64)
    except OSError as error:
        made.close()
        raise InputError(
            f"{host}:{port}: cannot be listened on ({error.strerror}); choose another --port, or leave it out"
        ) from None
    return made


def _uvicorn() -> Any:
    try:
        import starlette  # noqa: F401 - is it there?
        import uvicorn
        import websockets  # noqa: F401
    except ImportError as error:
        raise UnsupportedError(
            f"the studio needs {error.name}, which is not installed; pip install starlette uvicorn websockets"
        ) from None
    return uvicorn
