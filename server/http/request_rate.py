"""Request rates: a limit on the requests of each visitor, by token buckets."""

from __future__ import annotations

from math import ceil
from typing import Final

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Scope

from foldback.server.errors import ServiceError, TooMany
from foldback.server.http.client_address import address_of
from foldback.server.http.problems import Guard
from foldback.server.limits.fair_threads import CURRENT_VISITOR
from foldback.server.limits.token_buckets import TokenBuckets

EXEMPT_PATH: Final = "/health"
"""Path of the health check, which monitoring requests; it has no rate limit."""


class RequestRate(Guard):
    """Middleware that rejects a visitor's requests above the rate limit.

    Args:
        app: Inner ASGI application.
        rate: Permitted requests per second.
        burst: Permitted number of requests at once after a pause.
    """

    def __init__(self, app: ASGIApp, *, rate: float, burst: int) -> None:
        super().__init__(app)
        self._rate = rate
        self._buckets = TokenBuckets(rate, burst)

    def refusal(self, scope: Scope) -> ServiceError | None:
        """Return the refusal of a request above the rate limit."""
        if scope["path"] == EXEMPT_PATH:
            return None
        visitor = address_of(HTTPConnection(scope))
        CURRENT_VISITOR.set(visitor)
        wait_s = ceil(self._buckets.take(visitor))
        if not wait_s:
            return None
        return TooMany(
            "too-many-requests",
            "got more than {limit:g} requests per second from your address; try again in "
            "{retry_after_s} s.",
            retry_after_s=wait_s,
            limit=self._rate,
        )
