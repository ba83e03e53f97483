"""Rates: how many requests a visitor may make, by a token bucket for each."""

from __future__ import annotations

from math import ceil
from typing import Final

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Scope

from server.errors import ServiceError, TooMany
from server.http.client_address import address_of
from server.http.problems import Guard
from server.limits.fair_threads import CURRENT_VISITOR
from server.limits.token_buckets import TokenBuckets

EXEMPT_PATH: Final = "/health"
"""Path of the health check, which monitoring requests; it has no rate limit."""


class RequestRate(Guard):
    """Refuses the requests of a visitor that come faster than they may.

    Args:
        app: Inner ASGI application.
        rate: Requests a second.
        burst: Requests at once, after a while without any.
    """

    def __init__(self, app: ASGIApp, *, rate: float, burst: int) -> None:
        super().__init__(app)
        self._rate = rate
        self._buckets = TokenBuckets(rate, burst)

    def refusal(self, scope: Scope) -> ServiceError | None:
        """Return the refusal of one request too many."""
        if scope["path"] == EXEMPT_PATH:
            return None
        visitor = address_of(HTTPConnection(scope))
        CURRENT_VISITOR.set(visitor)
        wait_s = ceil(self._buckets.take(visitor))
        if not wait_s:
            return None
        return TooMany(
            "too-many-requests",
            f"got more than {self._rate:g} requests per second from your address; try again in "
            f"{wait_s} s.",
            retry_after_s=wait_s,
        )
