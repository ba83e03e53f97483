"""Retries: which requests to repeat, and the pauses between them."""

from __future__ import annotations

from dataclasses import dataclass
from random import SystemRandom
from typing import Final

RETRIED_STATUSES: Final = frozenset({429, 502, 503})
"""HTTP statuses after which the client repeats a request: too many requests (429), and a service
that is restarting (502, 503)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Retries:
    """Exponential backoff with jitter between the attempts of one request.

    Attributes:
        attempts: Maximum number of attempts, including the first.
        first_s: Approximate pause before the second attempt, in s.
        longest_s: Maximum pause, in s. If the service asks for a longer one, its problem is raised.
    """

    attempts: int = 6
    first_s: float = 0.25
    longest_s: float = 60.0

    def pause_s(self, attempt: int, retry_after: float | None = None) -> float | None:
        """Return the pause in s after an attempt, counted from 1; None to give up."""
        requested_s = retry_after or 0.0
        if attempt >= self.attempts or requested_s > self.longest_s:
            return None
        return requested_s + self.spread_s(attempt)

    def spread_s(self, attempt: int) -> float:
        """Return a random pause in s that doubles with each attempt up to ``longest_s``."""
        doubled = min(self.longest_s, self.first_s * 2.0 ** min(attempt - 1, 30))
        return doubled * SystemRandom().uniform(0.5, 1.0)
