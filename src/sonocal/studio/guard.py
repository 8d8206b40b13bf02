"""Who may talk to the server: its own page in the browser that was given the key, and nobody else."""

from __future__ import annotations

import hmac
import secrets
from http.cookies import CookieError, SimpleCookie
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["CSP", "Guard"]

CSP = "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
HEADERS = {
    "Content-Security-Policy": CSP,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
SAFE = ("GET", "HEAD")


class Guard:
    """An ASGI application around another that refuses whoever is not the page.

    A name that leads here by foreign DNS is not on the list of hosts; a foreign page's requests carry its own Origin;
    another user of the machine knows no key. The key is good once: whoever has it first is given a cookie.
    """

    def __init__(self, app: ASGIApp, hosts: frozenset[str], port: int) -> None:
        """Guard an application.

        Args:
            app: what is guarded.
            hosts: what a request's Host may be, with the port.
            port: of the server; cookies of several servers are told apart by it.
        """
        self.app, self.hosts = app, hosts
        self.key = secrets.token_urlsafe(24)
        self.cookie = f"sonocal-studio-{port}"
        self._secret = secrets.token_urlsafe(32)
        self._key_used = False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, or refuse."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        headers = {
            name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]
        }
        refused = self._refusal(scope, headers)
        given = refused is None and not self._known(headers) and self._take_key(scope)
        if refused is None and not given and not self._known(headers):
            refused = (401, "open the address that sonocal studio printed: it holds a key that is good once")
        if refused is not None:
            await _refuse(scope, receive, send, *refused)
            return
        await self.app(scope, receive, self._with_headers(send, cookie=given))

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        """Host and Origin."""
        if headers.get("host", "").lower() not in self.hosts:
            return 421, "this name is not one of the server's; use the address that sonocal studio printed"
        changing = scope["type"] == "websocket" or scope["method"] not in SAFE
        origin = headers.get("origin")
        if (changing or origin is not None) and not self._is_own(origin):
            return 403, "this request comes from another page"
        return None

    def _is_own(self, origin: str | None) -> bool:
        return origin is not None and origin.lower() in {f"http://{host}" for host in self.hosts}

    def _known(self, headers: dict[str, str]) -> bool:
        """Whether the browser has the cookie."""
        try:
            cookies = SimpleCookie(headers.get("cookie", ""))
        except CookieError:
            return False
        found = cookies.get(self.cookie)
        return found is not None and hmac.compare_digest(found.value.encode(), self._secret.encode())

    def _take_key(self, scope: Scope) -> bool:
        """Whether the page is asked for with the key, which is used up by that."""
        if scope["type"] != "http" or scope["path"] != "/" or scope["method"] != "GET" or self._key_used:
            return False
        given = parse_qs(scope["query_string"].decode("latin-1")).get("key", [""])[0]
        self._key_used = hmac.compare_digest(given.encode(), self.key.encode())
        return self._key_used

    def _with_headers(self, send: Send, *, cookie: bool) -> Send:
        async def wrapped(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = dict(HEADERS)
                if cookie:
                    own["Set-Cookie"] = f"{self.cookie}={self._secret}; HttpOnly; SameSite=Strict; Path=/"
                message = {**message, "headers": [*message["headers"], *_encoded(own)]}
            await send(message)

        return wrapped


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, sentence: str) -> None:
    """A refusal: of a WebSocket before it is open."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": sentence[:120]})
        return
    body = f"sonocal studio: {sentence}\n".encode()
    headers: dict[str, Any] = {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))}
    await send({"type": "http.response.start", "status": status, "headers": _encoded(HEADERS | headers)})
    await send({"type": "http.response.body", "body": body})


def _encoded(headers: dict[str, str]) -> list[tuple[bytes, bytes]]:
    return [(name.lower().encode(), value.encode()) for name, value in headers.items()]
