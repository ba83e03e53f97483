"""Robot rates: how many joint angles and speeds per second are sent to robots."""

from __future__ import annotations

from typing import Final

from server.limits.token_buckets import TokenBuckets

NUMBERS_PER_SECOND_OF_VISITOR: Final = 200_000.0
"""Number of joint angles and speeds per second that the service sends to all robots of one visitor;
with more, each robot gets fewer targets per second. Writing 200 000 of them takes about 0.1 s of
processor time, measured. A smaller value slows robots with many joints; a larger one lets robots
delay other visitors more."""
VISITORS_AT_FULL_RATE: Final = 4
"""Limit of the numbers that are sent to the robots of all visitors, as a multiple of one visitor's.
Beyond it, robots of visitors that have used half of their reserve get fewer targets. A larger value
lets robots delay other visitors more. Chosen."""
ALL_VISITORS: Final = "all"


class RobotRates:
    """Counts of numbers sent to robots, per visitor and in total. Belongs to one event loop."""

    def __init__(self) -> None:
        rate = NUMBERS_PER_SECOND_OF_VISITOR
        self._half = rate / 2
        self._visitors = TokenBuckets(rate, rate)
        self._all = TokenBuckets(VISITORS_AT_FULL_RATE * rate, VISITORS_AT_FULL_RATE * rate)

    def charge(self, visitor: str, numbers: int) -> float:
        """Count numbers sent to a visitor's robot; return the wait before its next target, s."""
        shared_s = self._all.charge(ALL_VISITORS, numbers)
        own_s = self._visitors.charge(visitor, numbers)
        busy = self._visitors.tokens(visitor) < self._half
        return max(own_s, shared_s) if busy else own_s
