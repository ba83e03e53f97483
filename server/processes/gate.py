"""Gates: what costs time and memory happens a few times at once, and a few may wait for that."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Final

from server.errors import ServiceError, TooMany, Unavailable
from server.limits.quota import Quota

PATIENCE_S: Final = 10.0
RETRY_AFTER_S: Final = 5
LOOK_EVERY_S: Final = 0.1


class Gate:
    """Lets a few threads through at once. Safe to use from many of them.

    Args:
        what: What is made behind it, in the plural.
        at_once: How many are let through at once.
        most: How many may be behind it or wait before it.
        most_of_visitor: Of them, of one visitor.
        at_once_of_visitor: How many of one visitor are let through at once; all when None.
        patience_s: How long one may wait.
    """

    def __init__(
        self,
        what: str,
        *,
        at_once: int,
        most: int,
        most_of_visitor: int,
        at_once_of_visitor: int | None = None,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self._what = what
        self._patience_s = patience_s
        self._quota = Quota(
            what,
            total=most,
            per_visitor=most_of_visitor,
            at_once=at_once,
            at_once_per_visitor=at_once_of_visitor,
            refuse=self._full,
        )

    @property
    def waiting(self) -> int:
        """How many are behind it or wait before it."""
        return len(self._quota)

    @contextmanager
    def passed(
        self, visitor: str, *, unwanted: Callable[[], bool] | None = None
    ) -> Generator[None]:
        """Waits for a visitor's turn, which lasts as long as the context.

        Args:
            visitor: Whose turn.
            unwanted: Asked often while it waits; once True, nobody wants it any more.

        Raises:
            ServiceError: When too many of the visitor wait, or of all, or for too long, or when
                it is not wanted any more.
        """
        turn = threading.Event()
        with self._quota.enter(visitor, lambda _: turn.set()):
            deadline = time.monotonic() + self._patience_s
            while not turn.wait(min(LOOK_EVERY_S, self._patience_s)):
                if unwanted is not None and unwanted():
                    raise Unavailable("gone", "Nobody waited for this any more.")
                if time.monotonic() >= deadline:
                    raise _busy(Unavailable, f"Others are having {self._what} made")
            yield

    def _full(self, count: int, own: bool) -> ServiceError:
        if own:
            return _busy(TooMany, f"{count} {self._what} of yours are being made")
        return _busy(Unavailable, f"{count} {self._what} of others are being made")


def _busy(kind: type[ServiceError], why: str) -> ServiceError:
    return kind("busy", f"{why}; try again in {RETRY_AFTER_S} s.", retry_after_s=RETRY_AFTER_S)
