"""Frame waits: requests that wait until a growing timeline has more frames.

One thread looks at the timelines of all waiting requests, one after the other. A request that
waits holds no thread, only a permit of the quota of its visitor and its networks.
"""

from __future__ import annotations

import asyncio
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import Final

from planner.errors import TimelineError
from server.errors import TooMany
from server.limits.concurrency_quota import Holder, Quota
from web.timeline.view import TimelineView

FRAME_POLL_S: Final = 0.1
"""Time between two checks for new frames in the motions that long-polling requests wait for, in s.
A larger value shows new frames later; a smaller one reads files more often. Chosen."""
FRAME_RETRY_S: Final = 2
"""Value of the ``Retry-After`` header, in s, if too many requests wait for new frames. No request
waits longer than this time, so that others have been answered by then."""
MAX_WAITS: Final = 512
"""Maximum number of requests that wait for new frames at the same time (long polling); further ones
are refused with 429. A larger value keeps more connections open. Chosen."""
MAX_WAITS_OF_VISITOR: Final = 32
"""Maximum number of requests of one visitor (IP address) that wait for new frames at the same time;
further ones are refused with 429. A larger value lets one visitor occupy more of the common limit.
Chosen."""


class FrameWaits:
    """Requests that wait for frames, and the thread that looks for these.

    Args:
        total: Maximum number of requests that wait at once.
        per_visitor: Maximum of one visitor.
    """

    def __init__(self, total: int = MAX_WAITS, per_visitor: int = MAX_WAITS_OF_VISITOR) -> None:
        self._quota = Quota(
            "frame waits", total=total, per_visitor=per_visitor, refuse=_too_many_waits
        )
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="frame-waits")

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    @contextmanager
    def place(self, visitor: str) -> Generator[asyncio.Event]:
        """Hold a place among the waiting requests.

        Yields:
            An event that ends the wait; a newcomer that displaces the visitor sets it.

        Raises:
            TooMany: If there is no place.
        """
        over = asyncio.Event()
        with self._quota.enter(visitor, end=over.set):
            yield over

    async def until(
        self, timeline: TimelineView, start: int, over: asyncio.Event, *, timeout_s: float
    ) -> None:
        """Wait until a timeline has a frame, is complete, ``over`` is set, or the time is up.

        A timeline that cannot be read ends the wait.
        """
        loop = asyncio.get_running_loop()
        with suppress(TimeoutError, TimelineError, OSError, ValueError):
            async with asyncio.timeout(timeout_s):
                while start >= len(timeline) and timeline.growing and not over.is_set():
                    await loop.run_in_executor(self._thread, timeline.refresh)
                    await asyncio.sleep(FRAME_POLL_S)


def _too_many_waits(count: int, holder: Holder) -> TooMany:
    return TooMany(
        "too-many-waits",
        f"{count} requests {holder} are waiting for frames, which is the limit; send this one "
        f"without 'wait', or try again in {FRAME_RETRY_S} s.",
        retry_after_s=FRAME_RETRY_S,
    )
