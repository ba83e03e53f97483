"""Token buckets: rate limits of visitors and of the networks around them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from cachetools import LRUCache

from foldback.server.limits.networks import networks_of

NETWORK_RATE_FACTOR: Final = 2.0
"""Rate limit and burst of a network of IP addresses, as a multiple of one visitor's."""
VISITORS_AT_FULL_RATE: Final = 4
"""Rate limit and burst of all visitors together, as a multiple of one visitor's, for limits that
visitors share. Beyond it the visitors that have used half of their own tokens have to wait."""
ALL_VISITORS: Final = "all"


class TokenBuckets:
    """Token bucket of each visitor and of each network around it. For one thread.

    Args:
        rate: Tokens per second of a visitor; a network gets ``NETWORK_RATE_FACTOR`` times as many.
        burst: Tokens in a visitor's full bucket.
        most: Maximum number of stored buckets.
        clock: Returns the time in seconds.
    """

    def __init__(
        self,
        rate: float,
        burst: float,
        *,
        max_buckets: int = 50_000,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._rate = rate
        self._burst = burst
        self._clock = clock
        self._buckets: LRUCache[str, tuple[float, float]] = LRUCache(max_buckets)
        """Tokens and the time of their count, by visitor and network."""

    def __len__(self) -> int:
        return len(self._buckets)

    def take(self, visitor: str) -> float:
        """Take one token of a visitor and its networks.

        Returns:
            0, or the seconds until all buckets have a token; then none is taken.
        """
        now = self._clock()
        buckets = self._tokens(visitor, now)
        wait_s = max(max(0.0, (1.0 - tokens) / rate) for _, tokens, rate in buckets)
        for name, tokens, _ in buckets:
            self._buckets[name] = (tokens if wait_s else tokens - 1.0, now)
        return wait_s

    def charge(self, visitor: str, amount: float) -> float:
        """Take tokens for events that have already happened, even if there are too few.

        Returns:
            Seconds until no bucket is negative.
        """
        now = self._clock()
        wait_s = 0.0
        for name, tokens, rate in self._tokens(visitor, now):
            self._buckets[name] = (tokens - amount, now)
            wait_s = max(wait_s, (amount - tokens) / rate)
        return wait_s

    def tokens(self, visitor: str) -> float:
        """Return the number of a visitor's tokens; negative if it has used too many."""
        return next(tokens for _, tokens, _ in self._tokens(visitor, self._clock()))

    def _tokens(self, visitor: str, now: float) -> list[tuple[str, float, float]]:
        """Return the name, tokens and rate of a visitor's bucket and those of its networks."""
        factors = {visitor: 1.0, **dict.fromkeys(networks_of(visitor), NETWORK_RATE_FACTOR)}
        buckets: list[tuple[str, float, float]] = []
        for name, factor in factors.items():
            burst, rate = factor * self._burst, factor * self._rate
            tokens, at = self._buckets.get(name, (burst, now))
            buckets.append((name, min(burst, tokens + (now - at) * rate), rate))
        return buckets


class SharedBuckets:
    """Token buckets of visitors and networks, and one of all visitors. For one thread.

    Args:
        rate: Tokens per second of a visitor.
        burst: Tokens in a visitor's full bucket.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self._visitors = TokenBuckets(rate, burst)
        self._all = TokenBuckets(VISITORS_AT_FULL_RATE * rate, VISITORS_AT_FULL_RATE * burst)
        self._light = burst / 2

    def charge(self, visitor: str | None, amount: float) -> float:
        """Take tokens for events that have already happened; None is an unknown visitor.

        Returns:
            Seconds that the visitor has to wait.
        """
        shared_s = self._all.charge(ALL_VISITORS, amount)
        if visitor is None:
            return 0.0
        own_s = self._visitors.charge(visitor, amount)
        # A visitor with at least half of its tokens does not wait for the others.
        busy = self._visitors.tokens(visitor) < self._light
        return max(own_s, shared_s) if busy else own_s
