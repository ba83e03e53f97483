"""Read-only disk: changes are refused before their body is read; all else works."""

from __future__ import annotations

from collections.abc import Callable

from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from foldback.server.errors import read_only
from foldback.server.http.problems import Problem, answer_of
from foldback.server.http.security import SAFE_METHODS


class ReadOnly:
    """Middleware that refuses all requests that would change something.

    Args:
        app: Inner ASGI application.
        page: Creates the error page for browsers.
    """

    def __init__(self, app: ASGIApp, *, page: Callable[[Problem], Response]) -> None:
        self._app = app
        self._page = page

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http" or scope["method"] in SAFE_METHODS:
            await self._app(scope, receive, send)
            return
        problem = Problem.of(read_only())
        await answer_of(HTTPConnection(scope), problem, self._page)(scope, receive, send)
