"""Answers to requests that a stopping process has no time to finish."""

from __future__ import annotations

import asyncio
from typing import Final

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from foldback.server.errors import Unavailable
from foldback.server.http.problems import response_of

RETRY_S: Final = 1
"""Value of the ``Retry-After`` header, in s: a load balancer then knows of the stopping process."""


class CutRequests:
    """Middleware that answers 503 to a request that the server cancels when it stops.

    Without it, uvicorn answers 500.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        started = scope["type"] != "http"

        async def send_watched(message: Message) -> None:
            nonlocal started
            started = True
            await send(message)

        try:
            await self._app(scope, receive, send_watched)
        except asyncio.CancelledError:
            if started:
                raise
            words = "The service is stopping; nothing was lost. Try again in {retry_after_s} s."
            stopping = Unavailable("stopping", words, retry_after_s=RETRY_S)
            await response_of(stopping)(scope, receive, send)
