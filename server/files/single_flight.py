"""Single flight: what takes seconds is made once for all who ask for it meanwhile.

It has threads of its own, so that those of the event loop stay free for what is quick, and whoever
waits holds none. Visitors take turns.
"""

from __future__ import annotations

import asyncio
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final, TypeVar

from server.errors import ServiceError, TooMany, Unavailable

RETRY_AFTER_S: Final = 3
Thing = TypeVar("Thing")


class SingleFlight:
    """See the module's description. Belongs to one event loop.

    Args:
        what: What is made, in the plural.
        at_once: How many things are made at once.
        most: How many may be made or wait for it.
        most_of_visitor: Of them, of one visitor.
    """

    def __init__(self, what: str, *, at_once: int, most: int, most_of_visitor: int) -> None:
        self._what = what
        self._threads = ThreadPoolExecutor(at_once, thread_name_prefix=what.replace(" ", "-"))
        self._making: dict[Hashable, asyncio.Future[Any]] = {}
        self._most = most
        self._most_of_visitor = most_of_visitor
        self._visitors: dict[Hashable, str] = {}
        """Who had each of the things made."""
        self._lock = threading.Lock()
        self._line: OrderedDict[str | None, deque[tuple[Future[Any], Callable[[], Any]]]] = (
            OrderedDict()
        )
        """What waits, by visitor; the visitor whose turn was longest ago comes first."""

    def __len__(self) -> int:
        """How many things are being made or wait for it."""
        return len(self._making)

    def close(self) -> None:
        """Begins nothing any more."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        with self._lock:
            for made, _ in (one for line in self._line.values() for one in line):
                made.cancel()
            self._line.clear()

    async def made(
        self, key: Hashable, make: Callable[[], Thing], *, visitor: str | None = None
    ) -> Thing:
        """What ``make`` returns; whoever asks for the same key meanwhile gets the same.

        Raises:
            ServiceError: When too many of the visitor's wait, or of all.
        """
        making = self._making.get(key)
        if making is None:
            self._check(visitor)
            if visitor is not None:
                self._visitors[key] = visitor
            making = asyncio.wrap_future(self._queue(make, visitor))
            self._making[key] = making

            def done(making: asyncio.Future[Any]) -> None:
                del self._making[key]
                self._visitors.pop(key, None)
                if not making.cancelled():
                    making.exception()  # whoever waited was told; nobody may be left

            making.add_done_callback(done)
        # Who goes away does not take it from the others that wait for it.
        return await asyncio.shield(making)

    def _queue(self, make: Callable[[], Thing], visitor: str | None) -> Future[Thing]:
        made: Future[Thing] = Future()
        with self._lock:
            self._threads.submit(self._make_next)
            self._line.setdefault(visitor, deque()).append((made, make))
        return made

    def _make_next(self) -> None:
        with self._lock:
            if not self._line:  # closed meanwhile
                return
            visitor, line = next(iter(self._line.items()))
            made, make = line.popleft()
            if line:
                self._line.move_to_end(visitor)
            else:
                del self._line[visitor]
        if made.set_running_or_notify_cancel():
            try:
                made.set_result(make())
            except BaseException as error:
                made.set_exception(error)

    def _check(self, visitor: str | None) -> None:
        own = list(self._visitors.values()).count(visitor) if visitor is not None else 0
        if own >= self._most_of_visitor:
            raise self._busy(TooMany, f"{own} other {self._what} of yours are being made")
        if len(self._making) >= self._most:
            raise self._busy(Unavailable, f"{len(self._making)} other {self._what} are being made")

    def _busy(self, kind: type[ServiceError], why: str) -> ServiceError:
        return kind(
            "busy",
            f"{why}; try again in a moment.",
            retry_after_s=RETRY_AFTER_S,
        )
