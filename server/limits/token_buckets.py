"""Token buckets: how many requests a visitor may make a second, and at once after a while."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from cachetools import LRUCache

MOST_VISITORS: Final = 50_000
"""Visitors whose buckets are remembered; one that is forgotten begins with a full one."""


class TokenBuckets:
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
