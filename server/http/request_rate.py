"""Rates: how many requests a visitor may make, by a token bucket for each."""

from __future__ import annotations

from math import ceil
from typing import Final

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from server.errors import TooMany
from server.http.client_address import address_of
from server.http.problems import response_of
from server.limits.fair_threads import CURRENT_VISITOR
from server.limits.token_buckets import TokenBuckets

EXEMPT_PATH: Final = "/health"
"""Path of the health check, which monitoring requests; it has no rate limit."""


class RequestRate:
    """Refuses the requests of a visitor that come faster than they may.

    Args:
        app: Inner ASGI application.
        rate: Requests a second.
        burst: Requests at once, after a while without any.
    """

    def __init__(self, app: ASGIApp, *, rate: float, burst: int) -> None:
        self._app = app
        self._rate = rate
        self._buckets = TokenBuckets(rate, burst)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] not in ("http", "websocket") or scope["path"] == EXEMPT_PATH:
            await self._app(scope, receive, send)
            return
        visitor = address_of(HTTPConnection(scope))
        CURRENT_VISITOR.set(visitor)
        wait_s = self._buckets.take(visitor)
        if not wait_s:
            await self._app(scope, receive, send)
        else:
            refusal = TooMany(
                "too-many-requests",
                f"got more than {self._rate:g} requests per second from your address; try again in "
                f"{ceil(wait_s)} s.",
                retry_after_s=ceil(wait_s),
            )
            await response_of(refusal)(scope, receive, send)
