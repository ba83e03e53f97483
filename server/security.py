"""Security: what every answer tells browsers, and whose pages may talk to the service."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.problems import Problem

PAGE_POLICY: Final = "; ".join(
    (
        "default-src 'self'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "connect-src 'self' data: blob:",
        "worker-src 'self' blob:",
        "frame-src 'self'",
        "frame-ancestors 'self'",
        "form-action 'self'",
        "base-uri 'none'",
        "object-src 'none'",
    )
)
HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
}
SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
FORM_OVERHEAD_BYTES: Final = 64 * 1024
UPLOAD_SECONDS: Final = 120.0


class SecurityHeaders:
    """Adds the headers to every answer; a route may set its own instead."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                headers.setdefault("Content-Security-Policy", PAGE_POLICY)
            await send(message)

        await self._app(scope, receive, send_with_headers)


class SameOrigin:
    """Refuses websockets and changes that come from pages of other sites.

    Programs other than browsers send no Origin and are let through: they act for nobody else.
    """

    def __init__(self, app: ASGIApp, origins: Iterable[str] = ()) -> None:
        self._app = app
        self._origins = frozenset(origins)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] == "websocket" and not self._allowed(Headers(scope=scope)):
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": "foreign origin"})
            return
        if (
            scope["type"] == "http"
            and scope["method"] not in SAFE_METHODS
            and not self._allowed(Headers(scope=scope))
        ):
            problem = Problem(
                403, "foreign-origin", "Pages of other sites may not change anything here."
            )
            await problem.response()(scope, receive, send)
            return
        await self._app(scope, receive, send)

    def _allowed(self, headers: Headers) -> bool:
        origin = headers.get("origin")
        if origin is None or origin in self._origins:
            return True
        host = headers.get("host", "").lower()
        try:
            found = urlsplit(origin)
        except ValueError:
            return False
        return found.scheme in ("http", "https") and bool(host) and found.netloc.lower() == host


class BodyLimit:
    """Counts what comes in, and refuses more than the limit before it fills memory or disk."""

    def __init__(self, app: ASGIApp, *, most_bytes: int) -> None:
        self._app = app
        self._most = most_bytes + FORM_OVERHEAD_BYTES
        self._words = (
            f"the upload is larger than the {most_bytes} bytes that are accepted; "
            "use a coarser or shorter file."
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] != "http" or scope["method"] in SAFE_METHODS:
            await self._app(scope, receive, send)
            return
        got = 0
        more = True
        loop = asyncio.get_running_loop()
        deadline = loop.time() + UPLOAD_SECONDS

        async def receive_counted() -> Message:
            nonlocal got, more
            if not more:  # what comes after the body is only the end of the connection
                return await receive()
            message = await asyncio.wait_for(receive(), max(0.0, deadline - loop.time()))
            if message["type"] == "http.request":
                got += len(message.get("body", b""))
                more = message.get("more_body", False)
            return message

        async def receive_bounded() -> Message:
            try:
                message = await receive_counted()
                if got > self._most:
                    # Clients read the answer only when they could send; listen on for a while.
                    while more and got <= 8 * self._most:
                        await receive_counted()
                    raise HTTPException(413, self._words)
            except TimeoutError:
                raise HTTPException(408, "the upload took too long; try again.") from None
            return message

        await self._app(scope, receive_bounded, send)
