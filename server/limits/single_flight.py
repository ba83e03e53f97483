"""Single flight: concurrent requests for the same slow result share one computation.

It has its own threads, so that those of the event loop stay free for quick work, and waiting
requests occupy none. Visitors take turns.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar

from foldback.server.errors import ServiceError, TooMany, Unavailable
from foldback.server.limits.concurrency_quota import Holder, Permit, Quota
from foldback.web.timeline.cache import Cache

Thing = TypeVar("Thing")


class SingleFlight:
    """Shared computations; see the module's description. For one event loop.

    Args:
        what: Name of the results in messages, in the plural.
        at_once: Maximum number of results that are computed at the same time.
        total: Maximum number of results that are being computed or wait.
        per_visitor: Maximum number of these for one visitor.
    """

    def __init__(self, subject: str, *, at_once: int, total: int, per_visitor: int) -> None:
        def busy(count: int, holder: Holder) -> ServiceError:
            whose = "" if holder is Holder.ALL else f" {holder}"
            return (Unavailable if holder is Holder.ALL else TooMany)(
                "busy",
                f"{count} other {subject}{whose} are being created; try again in a moment.",
                retry_after_s=3,
            )

        self._busy = busy
        self._quota = Quota(
            subject, total=total, per_visitor=per_visitor, at_once=at_once, refuse=busy
        )
        self._threads = ThreadPoolExecutor(at_once, thread_name_prefix=subject.replace(" ", "-"))
        self._making: dict[Hashable, asyncio.Future[Any]] = {}

    def close(self) -> None:
        """Cancel waiting computations and start no more."""
        for making in self._making.values():
            making.cancel()
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def get_or_make(
        self,
        key: Hashable,
        make: Callable[[], Thing],
        *,
        visitor: str | None = None,
        cache: Cache[Thing] | None = None,
    ) -> Thing:
        """Return the result of ``make``; concurrent calls with the same key share one result.

        Args:
            key: Key of the result.
            make: Computes the result; called in a thread.
            visitor: Visitor that requests the result.
            cache: Cache of recent results; if None, results are not cached.

        Raises:
            ServiceError: If too many results wait, of the visitor or in total.
        """
        if cache is not None:
            if (stored := cache.get(key)) is not None:
                return stored
            make = partial(cache.get_or_make, key, make)
        if key not in self._making:
            making = self._making[key] = asyncio.ensure_future(self._made(make, visitor))
            making.add_done_callback(partial(self._forget, key))
        # A client that disconnects does not cancel the result for the others.
        return await asyncio.shield(self._making[key])

    async def _made(self, make: Callable[[], Thing], visitor: str | None) -> Thing:
        """Wait for the visitor's turn, and compute a result in a thread."""
        loop = asyncio.get_running_loop()
        turn: asyncio.Future[Permit] = loop.create_future()

        def displaced() -> None:
            turn.set_exception(self._busy(len(self._quota), Holder.ALL))

        with self._quota.enter(visitor, turn.set_result, end=displaced):
            await turn
            return await loop.run_in_executor(self._threads, make)

    def _forget(self, key: Hashable, making: asyncio.Future[Any]) -> None:
        del self._making[key]
        if not making.cancelled():
            making.exception()  # marks it as retrieved: all clients may have disconnected
