"""Fair threads: threads for short work, in which visitors take turns.

A plain pool processes calls in the order of arrival: 200 requests of one visitor would delay the
pages of all others. Here networks take turns, and within a network visitors; each of them leaves
at least one thread to others.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import ContextVar
from typing import Final, ParamSpec, TypeVar

from foldback.server.limits.concurrency_quota import Permit, Quota

CURRENT_VISITOR: Final[ContextVar[str | None]] = ContextVar("visitor", default=None)
"""Visitor (IP address) whose request the current task or thread processes, so that threads are
shared fairly between visitors; None outside of requests."""
MAX_REQUEST_THREADS: Final = min(32, (os.cpu_count() or 1) + 4)
"""Maximum number of threads that process requests: the default of ``ThreadPoolExecutor`` in
Python's standard library."""
Given = ParamSpec("Given")
Result = TypeVar("Result")


class FairThreads(ThreadPoolExecutor):
    """Thread pool in which visitors take turns; see the module's description.

    Args:
        count: Number of threads, at least 2.
    """

    def __init__(self, count: int = MAX_REQUEST_THREADS) -> None:
        super().__init__(count, thread_name_prefix="fair")
        self._turns = Quota(
            "threads",
            total=None,
            per_visitor=sys.maxsize,
            at_once=count,
            at_once_per_visitor=count - 1,
        )

    def submit(
        self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs
    ) -> Future[Result]:
        """Return the future of a call, made when it is the turn of ``CURRENT_VISITOR``."""
        future: Future[Result] = Future()

        def work(permit: Permit) -> None:
            with permit:
                if not future.set_running_or_notify_cancel():
                    return
                try:
                    future.set_result(fn(*args, **kwargs))
                except BaseException as error:
                    future.set_exception(error)

        def begin(permit: Permit) -> None:
            try:
                super(FairThreads, self).submit(work, permit)
            except RuntimeError:  # the pool is shut down
                future.cancel()

        self._turns.enter(CURRENT_VISITOR.get(), begin)
        return future
