"""Gates: what costs time and memory happens a few times at once, and a few may wait for that."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from typing import Final

from server.problems import Problem

PATIENCE_S: Final = 10.0
RETRY_AFTER_S: Final = 5


class Gate:
    """Lets a few through at once. Safe to use from many threads.

    Args:
        what: What is made behind it, in the plural.
        at_once: How many are let through at once.
        most: How many may be behind it or wait before it.
        most_of_visitor: Of them, of one visitor.
        patience_s: How long one may wait.
    """

    def __init__(
        self,
        what: str,
        *,
        at_once: int,
        most: int,
        most_of_visitor: int,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self._what = what
        self._most = most
        self._most_of_visitor = most_of_visitor
        self._patience_s = patience_s
        self._turns = threading.BoundedSemaphore(at_once)
        self._lock = threading.Lock()
        self._here: Counter[str] = Counter()

    @property
    def waiting(self) -> int:
        """How many are behind it or wait before it."""
        with self._lock:
            return self._here.total()

    @contextmanager
    def passed(self, visitor: str) -> Generator[None]:
        """Waits for a visitor's turn, which lasts as long as the context.

        Raises:
            Problem: When too many of the visitor wait (429), or of all, or for too long (503).
        """
        self._enter(visitor)
        try:
            if not self._turns.acquire(timeout=self._patience_s):
                raise _busy(503, f"Others are having {self._what} made")
            try:
                yield
            finally:
                self._turns.release()
        finally:
            with self._lock:
                self._here[visitor] -= 1
                if not self._here[visitor]:
                    del self._here[visitor]

    def _enter(self, visitor: str) -> None:
        with self._lock:
            if self._here[visitor] >= self._most_of_visitor:
                raise _busy(429, f"{self._here[visitor]} {self._what} of yours are being made")
            if self._here.total() >= self._most:
                raise _busy(503, f"{self._here.total()} {self._what} of others are being made")
            self._here[visitor] += 1


def _busy(status: int, why: str) -> Problem:
    return Problem(
        status,
        "busy",
        f"{why}; try again in {RETRY_AFTER_S} s.",
        headers={"Retry-After": str(RETRY_AFTER_S)},
    )
