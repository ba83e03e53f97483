"""Frame waits: requests that wait until a growing timeline has more frames.

One thread polls each timeline once for all requests that wait for it: polling per request would
occupy the event loop when hundreds of visitors watch a fold. A waiting request occupies no thread,
only a permit of the quota of its visitor and its networks.
"""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Final

from foldback.planner.errors import TimelineError
from foldback.server.errors import TooMany
from foldback.server.limits.concurrency_quota import Holder, Quota
from foldback.web.timeline.view import TimelineView

FRAME_RETRY_S: Final = 2
"""Value of the ``Retry-After`` header, in s, if too many requests wait for new frames. No request
waits longer than this time, so that others have been answered by then."""


@dataclass(frozen=True, slots=True, eq=False)
class _Wait:
    timeline: TimelineView
    start: int
    over: asyncio.Event

    @property
    def served(self) -> bool:
        """True once the awaited frame exists or can no longer appear."""
        return self.start < len(self.timeline) or not self.timeline.growing


class FrameWaits:
    """Requests that wait for frames, and the polling that wakes them. For one event loop.

    Args:
        total: Maximum number of requests that wait at once.
        per_visitor: Maximum number of requests of one visitor.
    """

    def __init__(self, total: int = 512, per_visitor: int = 32) -> None:
        self._quota = Quota(
            "frame waits", total=total, per_visitor=per_visitor, refuse=_too_many_waits
        )
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="frame-waits")
        self._waits: set[_Wait] = set()
        self._looking: asyncio.Task[None] | None = None

    def close(self) -> None:
        """Stop polling."""
        if self._looking is not None:
            self._looking.cancel()
        self._thread.shutdown(wait=False, cancel_futures=True)

    @contextmanager
    def place(self, visitor: str) -> Generator[asyncio.Event]:
        """Hold a permit for a waiting request.

        Yields:
            An event that ends the wait; a newcomer that displaces the visitor sets it.

        Raises:
            TooMany: If too many requests wait.
        """
        over = asyncio.Event()
        with self._quota.enter(visitor, end=over.set):
            yield over

    async def until(
        self, timeline: TimelineView, start: int, over: asyncio.Event, *, timeout_s: float
    ) -> None:
        """Wait until a timeline has a frame or is complete, ``over`` is set, or a timeout."""
        wait = _Wait(timeline, start, over)
        self._waits.add(wait)
        if self._looking is None or self._looking.done():
            self._looking = asyncio.create_task(self._look())
        try:
            with suppress(TimeoutError):
                await asyncio.wait_for(over.wait(), timeout_s)
        finally:
            self._waits.discard(wait)

    async def _look(self) -> None:
        loop = asyncio.get_running_loop()
        while self._waits:
            timelines = {wait.timeline for wait in self._waits}
            unreadable = await loop.run_in_executor(self._thread, _refresh, timelines)
            for wait in self._waits:
                if wait.served or wait.timeline in unreadable:
                    wait.over.set()
            await asyncio.sleep(0.1)


def _refresh(timelines: Collection[TimelineView]) -> set[TimelineView]:
    """Refresh timelines; return those that cannot be read, whose waits end."""
    unreadable: set[TimelineView] = set()
    for timeline in timelines:
        try:
            timeline.refresh()
        except (TimelineError, OSError, ValueError):
            unreadable.add(timeline)
    return unreadable


def _too_many_waits(count: int, holder: Holder) -> TooMany:
    return TooMany(
        "too-many-waits",
        f"{{count}} requests {holder} are waiting for frames, which is the limit; send this "
        "request without 'wait', or try again in {retry_after_s} s.",
        retry_after_s=FRAME_RETRY_S,
        count=count,
    )
