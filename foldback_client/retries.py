"""Retries: when to ask once more, and how long to wait before."""

from __future__ import annotations

from dataclasses import dataclass
from random import SystemRandom
from typing import Final

TRY_AGAIN: Final = frozenset({429, 502, 503})


@dataclass(frozen=True, slots=True, kw_only=True)
class Retries:
    """Waits double from one attempt to the next, and are spread so that clients do not march.

    Attributes:
        attempts: How often to ask, the first time included.
        first_s: About how long to wait before the second attempt.
        longest_s: The longest wait. When the service asks for a longer one, its problem is raised.
    """

    attempts: int = 6
    first_s: float = 0.25
    longest_s: float = 60.0

    def pause_s(self, attempt: int, retry_after: float | None = None) -> float | None:
        """How long to wait after the attempt of this number, from 1; None to give up."""
        asked = retry_after or 0.0
        if attempt >= self.attempts or asked > self.longest_s:
            return None
        return asked + self.spread_s(attempt)

    def spread_s(self, attempt: int) -> float:
        """A wait that doubles with each attempt up to the longest, and is never twice the same."""
        doubled = min(self.longest_s, self.first_s * 2.0 ** min(attempt - 1, 30))
        return doubled * SystemRandom().uniform(0.5, 1.0)
