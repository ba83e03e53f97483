"""Stream rates: how many joint angles and speeds per second target streams send."""

from __future__ import annotations

from typing import Final

from foldback.server.limits.token_buckets import SharedBuckets

NUMBERS_PER_SECOND_OF_VISITOR: Final = 200_000.0
"""Number of joint angles and speeds per second that the service sends to all target streams of one
visitor; with more, each stream gets fewer targets per second. Writing 200 000 of them takes about
0.1 s of processor time, measured."""


def stream_rates() -> SharedBuckets:
    """Return the counts of numbers that target streams send, per visitor and in total."""
    return SharedBuckets(NUMBERS_PER_SECOND_OF_VISITOR, NUMBERS_PER_SECOND_OF_VISITOR)
