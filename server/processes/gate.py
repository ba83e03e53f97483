"""Gates: what costs time and memory happens a few times at once, and a few may wait for that.

Visitors take turns: whoever asks for ten things waits for nine of them as long as others wait, and
others wait for one of his.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Final

from server.errors import ServiceError, TooMany, Unavailable

PATIENCE_S: Final = 10.0
RETRY_AFTER_S: Final = 5
LOOK_EVERY_S: Final = 0.1


class Gate:
    """Lets a few through at once. Safe to use from many threads.

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
        self._most = most
        self._most_of_visitor = most_of_visitor
        self._at_once_of_visitor = at_once_of_visitor or at_once
        self._patience_s = patience_s
        self._lock = threading.Lock()
        self._free = at_once
        self._inside: Counter[str] = Counter()
        self._line: OrderedDict[str, deque[threading.Event]] = OrderedDict()
        """Who waits, by visitor; the visitor whose turn was longest ago comes first."""

    @property
    def waiting(self) -> int:
        """How many are behind it or wait before it."""
        with self._lock:
            return self._inside.total() + sum(map(len, self._line.values()))

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
        turn = self._enter(visitor)
        deadline = time.monotonic() + self._patience_s
        try:
            while not turn.wait(min(LOOK_EVERY_S, self._patience_s)):
                if unwanted is not None and unwanted():
                    raise Unavailable("gone", "Nobody waited for this any more.")
                if time.monotonic() >= deadline:
                    raise _busy(Unavailable, f"Others are having {self._what} made")
            yield
        finally:
            self._leave(visitor, turn)

    def _enter(self, visitor: str) -> threading.Event:
        turn = threading.Event()
        with self._lock:
            own = self._inside[visitor] + len(self._line.get(visitor, ()))
            total = self._inside.total() + sum(map(len, self._line.values()))
            if own >= self._most_of_visitor:
                raise _busy(TooMany, f"{own} {self._what} of yours are being made")
            if total >= self._most:
                raise _busy(Unavailable, f"{total} {self._what} of others are being made")
            self._line.setdefault(visitor, deque()).append(turn)
            self._admit()
        return turn

    def _leave(self, visitor: str, turn: threading.Event) -> None:
        with self._lock:
            if turn.is_set():
                self._free += 1
                self._inside[visitor] -= 1
                if not self._inside[visitor]:
                    del self._inside[visitor]
            else:
                self._line[visitor].remove(turn)
                if not self._line[visitor]:
                    del self._line[visitor]
            self._admit()

    def _admit(self) -> None:
        """Lets through whose turn it is; called with the lock held."""
        while self._free:
            free = (v for v in self._line if self._inside[v] < self._at_once_of_visitor)
            visitor = next(free, None)
            if visitor is None:
                return
            turns = self._line[visitor]
            turns.popleft().set()
            self._free -= 1
            self._inside[visitor] += 1
            if turns:
                self._line.move_to_end(visitor)
            else:
                del self._line[visitor]


def _busy(kind: type[ServiceError], why: str) -> ServiceError:
    return kind(
        "busy",
        f"{why}; try again in {RETRY_AFTER_S} s.",
        retry_after_s=RETRY_AFTER_S,
    )
