"""Base path: path prefix of a service that shares its host with other sites."""

from __future__ import annotations

from contextvars import ContextVar
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

BASE_PATH: Final[ContextVar[str]] = ContextVar("base_path", default="")
"""Path prefix of the service for the current request; empty if it runs at the root."""

BELOW: Final = "foldback.below"
"""Entry of the scope of a request whose address had the base path."""


def at(path: str) -> str:
    """Return the address of a path of the service, for its pages."""
    return BASE_PATH.get() + path


class BelowPath:
    """Middleware that removes the base path from the address of each request.

    Inner applications see the addresses of a service at the root, also if the proxy has already
    removed the base path. Redirects get the base path again.

    Args:
        app: Inner ASGI application.
        base_path: Path such as ``/fold``; empty at the root.
    """

    def __init__(self, app: ASGIApp, *, base_path: str) -> None:
        self._app = app
        self._base_path = base_path

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if not self._base_path or scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        host = Headers(scope=scope).get("host", "")

        async def send_redirected(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                if (location := headers.get("location")) is not None:
                    headers["location"] = self._below(location, host)
            await send(message)

        path = scope["path"]
        if path == self._base_path or path.startswith(f"{self._base_path}/"):
            inner = path.removeprefix(self._base_path) or "/"
            scope = {**scope, "path": inner, "raw_path": inner.encode(), BELOW: True}
        token = BASE_PATH.set(self._base_path)
        try:
            await self._app(scope, receive, send_redirected)
        finally:
            BASE_PATH.reset(token)

    def _below(self, location: str, host: str) -> str:
        """Return the location of a redirect with the base path added."""
        address = urlsplit(location)
        if address.netloc not in ("", host) or not address.path.startswith("/"):
            return location
        return address._replace(path=self._base_path + address.path).geturl()
