"""The server's routes: the page, its images, its messages, what is uploaded and what is exported."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

import msgspec

from sonocal.errors import InputError, SonocalError
from sonocal.studio.bench import Bench
from sonocal.studio.desk import Desk
from sonocal.studio.following import Following
from sonocal.studio.images import shown_grey
from sonocal.studio.live_routes import live_routes
from sonocal.studio.marks import Edit
from sonocal.studio.page_files import page_files
from sonocal.studio.uploads import Uploads

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.websockets import WebSocket

__all__ = ["application"]

MOST_MESSAGE = 1 << 14
"""Bytes of one message of the page: an edit has a hundred."""


def application(desk: Desk, bench: Bench, uploads: Uploads, following: Following | None = None) -> Starlette:
    """The routes, without the guard before them.

    Args:
        desk: what the page looks at.
        bench: opens what it names.
        uploads: keeps what it sends.
        following: a live session; None without one.
    """
    from starlette.applications import Starlette
    from starlette.responses import JSONResponse, Response
    from starlette.routing import Route, WebSocketRoute

    files = page_files()

    def refused(error: Exception, status: int = 400) -> Response:
        return JSONResponse({"refused": str(error)}, status)

    def page(request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        if name not in files:
            return Response("there is no such file\n", 404, media_type="text/plain")
        content, kind = files[name]
        return Response(content, media_type=kind, headers={"Cache-Control": "no-cache"})

    def frame(request: Request) -> Response:
        work = desk.work
        try:
            if work is None:
                raise InputError("no recording is open")
            step = int(request.query_params.get("step", "1"))
            image = shown_grey(work.recording, request.path_params["index"], work.name, step)
        except (SonocalError, ValueError) as error:
            return refused(error, 404)
        shape = {"X-Width": str(image.shape[1]), "X-Height": str(image.shape[0])}
        return Response(
            image.tobytes(),
            media_type="application/octet-stream",
            headers={**shape, "Cache-Control": "no-store"},
        )

    def export(request: Request) -> Response:
        try:
            return JSONResponse({"files": desk.export()})
        except SonocalError as error:
            return refused(error)

    def exported(request: Request) -> Response:
        name = request.path_params["name"]
        content = desk.exported(name)
        if content is None:
            return Response("there is no such file\n", 404, media_type="text/plain")
        disposition = {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}
        return Response(content, media_type="application/octet-stream", headers=disposition)

    async def upload(request: Request) -> Response:
        try:
            name = await uploads.take(
                request.headers.get("x-name", ""), request.headers.get("content-length"), request.stream()
            )
        except SonocalError as error:
            return refused(error, 413 if "larger than" in str(error) else 400)
        return JSONResponse({"name": name})

    def asking(act: Callable[[dict[str, Any]], None]) -> Callable[[Request], Awaitable[Response]]:
        async def asked(request: Request) -> Response:
            try:
                await asyncio.to_thread(act, await _json(request))
            except SonocalError as error:
                return refused(error)
            return JSONResponse({})

        return asked

    async def events(socket: WebSocket) -> None:
        await socket.accept()
        await _Talk(desk, socket).run()

    return Starlette(
        routes=[
            Route("/", page),
            Route("/page/{name}", page),
            Route("/frames/{index:int}", frame),
            Route("/export", export, methods=["POST"]),
            Route("/files/{name}", exported),
            Route("/inputs", upload, methods=["PUT"]),
            Route("/open", asking(bench.open_named), methods=["POST"]),
            Route("/compare", asking(bench.compare_named), methods=["POST"]),
            Route("/tool", asking(bench.find_named), methods=["POST"]),
            *live_routes(following),
            WebSocketRoute("/events", events),
        ]
    )


async def _json(request: Request) -> dict[str, Any]:
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > MOST_MESSAGE:
            raise InputError(f"the request is larger than {MOST_MESSAGE} bytes")
    try:
        return msgspec.json.decode(body, type=dict[str, Any])
    except msgspec.DecodeError as error:
        raise InputError(f"the request is no JSON ({error})") from None


class _Talk:
    """One page: its edits come in, what it is to know goes out; of each kind of message the newest alone."""

    def __init__(self, desk: Desk, socket: WebSocket) -> None:
        self._desk, self._socket = desk, socket
        self._loop = asyncio.get_running_loop()
        self._waiting: dict[str, str] = {}
        self._wake = asyncio.Event()

    async def run(self) -> None:
        """Until the page goes away."""
        from starlette.websockets import WebSocketDisconnect

        def listener(message: dict[str, Any]) -> None:
            self._loop.call_soon_threadsafe(self._tell, message)

        stop = self._desk.listen(listener)
        sender = asyncio.create_task(self._send())
        try:
            while True:
                await self._heard(await self._socket.receive_text())
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            stop()
            sender.cancel()

    def _tell(self, message: dict[str, Any]) -> None:
        """Put a message in the row; one of its kind that is still there is out of date, answers to edits are not."""
        key = f"{message['kind']}:{message.get('id', '')}"
        self._waiting.pop(key, None)
        self._waiting[key] = json.dumps(message, separators=(",", ":"), allow_nan=False)
        self._wake.set()

    async def _send(self) -> None:
        while True:
            await self._wake.wait()
            self._wake.clear()
            waiting, self._waiting = self._waiting, {}
            for text in waiting.values():
                await self._socket.send_text(text)

    async def _heard(self, text: str) -> None:
        """An edit: it is on the disk before the page is told so."""
        name = ""
        try:
            edit = msgspec.json.decode(text, type=Edit)
            name = edit.id
            await asyncio.to_thread(self._desk.edit, edit)
        except msgspec.DecodeError as error:
            self._tell({"kind": "refused", "id": name, "sentence": f"this is no edit ({error})"})
        except SonocalError as error:
            self._tell({"kind": "refused", "id": name, "sentence": str(error)})
        else:
            self._tell({"kind": "kept", "id": name})
