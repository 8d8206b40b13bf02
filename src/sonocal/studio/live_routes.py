"""What the page asks of a live session: its newest image, cuts through what was scanned, and that it ends."""

from __future__ import annotations

import asyncio
import json
import time
from typing import TYPE_CHECKING
from urllib.parse import quote

from sonocal.errors import SonocalError
from sonocal.studio.feed import Feed, Shown
from sonocal.studio.following import Following

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.routing import Route

__all__ = ["live_routes"]

PATIENCE_S, POLL_S = 1.0, 0.02
NO_STORE = {"Cache-Control": "no-store"}


def live_routes(followed: Following | None) -> list[Route]:
    """The routes.

    Args:
        followed: None of a studio without a live session.
    """
    from starlette.responses import JSONResponse, Response
    from starlette.routing import Route

    def none() -> Response:
        return JSONResponse({"refused": "no scan is followed"}, 404)

    def after(request: Request) -> int:
        text = request.query_params.get("after", "-1")
        return int(text) if text.removeprefix("-").isdecimal() and len(text) < 12 else -1

    async def newest(request: Request) -> Response:
        """The newest image behind one, as soon as it is there; nothing (204) where none comes for a while."""
        last = after(request)
        if followed is None:
            return none()
        until_s, shown = time.monotonic() + PATIENCE_S, None
        while shown is None and followed.goes_on and time.monotonic() < until_s:
            if followed.feed.newest_number > last:
                shown = await asyncio.to_thread(_newest, followed.feed, last)
            if shown is None:
                await asyncio.sleep(POLL_S)
        if shown is None:
            return Response(status_code=204, headers=NO_STORE)
        rows, columns = shown.image.shape
        told = {"X-Width": str(columns), "X-Height": str(rows), "X-Told": json.dumps(shown.told)}
        return Response(shown.image.tobytes(), media_type="application/octet-stream", headers=NO_STORE | told)

    async def slices(request: Request) -> Response:
        """Cuts through what was scanned so far, unless they are known: then nothing (204)."""
        if followed is None:
            return none()
        volume, cuts = followed.feed.volume, followed.feed.volume.cuts
        if cuts is None or cuts.number <= after(request):
            return Response(status_code=204, headers=NO_STORE | {"X-Refused": quote(volume.refusal)})
        told = {"X-Told": json.dumps(cuts.told)}
        return Response(cuts.grey, media_type="application/octet-stream", headers=NO_STORE | told)

    def end(request: Request) -> Response:
        if followed is None:
            return none()
        followed.end()
        return JSONResponse({})

    return [
        Route("/live/frame", newest),
        Route("/live/slices", slices),
        Route("/live/end", end, methods=["POST"]),
    ]


def _newest(feed: Feed, after: int) -> Shown | None:
    try:
        return feed.newest(after)
    except (SonocalError, ValueError, OSError):  # it ended meanwhile, and its images are closed
        return None
