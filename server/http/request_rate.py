"""Rates: how many requests a visitor may make, by a token bucket for each."""

from __future__ import annotations

import time
from collections.abc import Callable
from math import ceil
from typing import Final

from cachetools import LRUCache
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from server.errors import TooMany
from server.http.client_address import address_of
from server.http.problems import response_of

MOST_VISITORS: Final = 50_000
"""Whose buckets are remembered; one that is forgotten begins full."""
EXEMPT: Final = "/health"
"""What watches a service asks it, though it be from the address of a visitor."""


class Buckets:
    """A bucket of tokens for each visitor, which fills up by the second. Belongs to one thread.

    Args:
        rate: Tokens a second.
        burst: Tokens in a full bucket.
        most: Buckets that are remembered.
        clock: What time it is, in seconds.
    """

    def __init__(
        self,
        rate: float,
        burst: float,
        *,
        most: int = MOST_VISITORS,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._rate = rate
        self._burst = burst
        self._clock = clock
        self._buckets: LRUCache[str, tuple[float, float]] = LRUCache(most)
        """Tokens and when they were counted, by visitor."""

    def __len__(self) -> int:
        return len(self._buckets)

    def take(self, visitor: str) -> float:
        """Takes a token of a visitor's; 0, or in how many seconds there is one if there is none."""
        now = self._clock()
        tokens, at = self._buckets.get(visitor, (self._burst, now))
        tokens = min(self._burst, tokens + (now - at) * self._rate)
        wait_s = max(0.0, (1.0 - tokens) / self._rate)
        self._buckets[visitor] = (tokens if wait_s else tokens - 1.0, now)
        return wait_s


class RequestRate:
    """Refuses the requests of a visitor that come faster than they may.

    Args:
        app: What is behind it.
        rate: Requests a second.
        burst: Requests at once, after a while without any.
    """

    def __init__(self, app: ASGIApp, *, rate: float, burst: int) -> None:
        self._app = app
        self._rate = rate
        self._buckets = Buckets(rate, burst)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] not in ("http", "websocket") or scope["path"] == EXEMPT:
            await self._app(scope, receive, send)
            return
        wait_s = self._buckets.take(address_of(HTTPConnection(scope)))
        if not wait_s:
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1013, "reason": "too many requests"})
        else:
            refusal = TooMany(
                "too-many-requests",
                f"got more requests from your address than the {self._rate:g} a second that are "
                f"answered; try again in {ceil(wait_s)} s.",
                retry_after_s=ceil(wait_s),
            )
            await response_of(refusal)(scope, receive, send)
