"""Quotas: at most so much at once, in all and of one visitor; some of it may wait for its turn.

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

CLOSED_RETRY_S: Final = 10
MADE_RETRY_S: Final = 5
TURN_TIMEOUT_S: Final = 10.0
LOOK_EVERY_S: Final = 0.1


class Permit:
    """What somebody has of a quota, until he leaves it; once at most."""

    def __init__(
        self, quota: Quota, visitor: str | None, begin: Callable[[Permit], object]
    ) -> None:
        self._quota = quota
        self.visitor = visitor
        self.begin = begin
        self.going = False

    def leave(self) -> None:
        """Makes room for somebody else."""
        self._quota.leave(self)

    def __enter__(self) -> Permit:
        return self

    def __exit__(self, *of: object) -> None:
        self.leave()


class Quota:
    """Counts permits. Safe to use from many threads.

    Args:
        what: What the permits are for, in the plural.
        total: Permits, those that wait included; no bound when None.
        per_visitor: How many of these one visitor may have; operators have no such bound.
        at_once: How many of them go on at once, while the others wait; all when None.
        at_once_per_visitor: Of those that go on, of one visitor; all when None.
        timeout_s: How long one may wait in ``turn``.
        refuse: What is raised when there is no permit: told how many are taken, and whether by the
            visitor himself.
    """

    def __init__(
        self,
        what: str,
        *,
        total: int | None,
        per_visitor: int,
        at_once: int | None = None,
        at_once_per_visitor: int | None = None,
        timeout_s: float = TURN_TIMEOUT_S,
        refuse: Callable[[int, bool], ServiceError] | None = None,
    ) -> None:
        self._what = what
        self._total = total
        self._per_visitor = per_visitor
        self._at_once = at_once
        self._at_once_per_visitor = at_once_per_visitor
        self._timeout_s = timeout_s
        self._refuse = refuse or (self._too_many if at_once is None else self._too_busy)
        self._lock = threading.Lock()
        self._count = self._going_count = 0
        self._held: Counter[str | None] = Counter()
        self._going: Counter[str | None] = Counter()
        self._line: OrderedDict[str | None, deque[Permit]] = OrderedDict()
        """Who waits, by visitor; the visitor whose turn was longest ago comes first."""

    def __len__(self) -> int:
        """How many permits are taken."""
        return self._count

    def enter(
        self, visitor: str | None, begin: Callable[[Permit], object] = lambda permit: None
    ) -> Permit:
        """Takes a permit.

        Args:
            visitor: Whose it is.
            begin: Called with the permit when it is its turn, by whoever made room; must not wait.

        Raises:
            ServiceError: When there is none.
        """
        permit = Permit(self, visitor, begin)
        with self._lock:
            own = self._held[visitor]
            if visitor is not None and own >= self._per_visitor:
                raise self._refuse(own, True)
            if self._total is not None and self._count >= self._total:
                raise self._refuse(self._count, False)
            self._count += 1
            self._held[visitor] += 1
            self._line.setdefault(visitor, deque()).append(permit)
            self._admit()
        return permit

    @contextmanager
    def turn(self, visitor: str, *, unwanted: Callable[[], bool] | None = None) -> Generator[None]:
        """Waits for a visitor's turn, which lasts as long as the context.

        Args:
            visitor: Whose turn.
            unwanted: Asked often while it waits; once True, nobody wants it any more.

        Raises:
            ServiceError: When there is no permit, or not in time, or nobody wants it any more.
        """
        begun = threading.Event()
        with self.enter(visitor, lambda _: begun.set()):
            deadline = time.monotonic() + self._timeout_s
            while not begun.wait(min(LOOK_EVERY_S, self._timeout_s)):
                if unwanted is not None and unwanted():
                    raise Unavailable("gone", "Nobody waited for this any more.")
                if time.monotonic() >= deadline:
                    raise _busy(Unavailable, f"Others are having {self._what} made")
            yield

    def leave(self, permit: Permit) -> None:
        """Gives a permit back, whether it waits or goes on."""
        visitor = permit.visitor
        with self._lock:
            self._count -= 1
            self._held[visitor] -= 1
            if permit.going:
                self._going_count -= 1
                self._going[visitor] -= 1
            else:
                self._line[visitor].remove(permit)
                if not self._line[visitor]:
                    del self._line[visitor]
            for counts in (self._held, self._going):
                if not counts[visitor]:
                    del counts[visitor]
            self._admit()

    def _admit(self) -> None:
        """Lets begin whose turn it is; called with the lock held."""
        while self._at_once is None or self._going_count < self._at_once:
            visitor = next((v for v in self._line if self._may_begin(v)), ...)
            if visitor is ...:
                return
            waiting = self._line[visitor]
            permit = waiting.popleft()
            if waiting:
                self._line.move_to_end(visitor)
            else:
                del self._line[visitor]
            self._going_count += 1
            self._going[visitor] += 1
            permit.going = True
            permit.begin(permit)

    def _may_begin(self, visitor: str | None) -> bool:
        most = self._at_once_per_visitor
        return most is None or self._going[visitor] < most

    def _too_many(self, count: int, own: bool) -> TooMany:
        return TooMany(
            f"too-many-{self._what.rpartition(' ')[2]}",
            f"{count} {self._what} {'of yours' if own else 'in all'} are open, which is the most "
            f"there may be; close one, or try again in {CLOSED_RETRY_S} s.",
            retry_after_s=CLOSED_RETRY_S,
        )

    def _too_busy(self, count: int, own: bool) -> ServiceError:
        if own:
            return _busy(TooMany, f"{count} {self._what} of yours are being made")
        return _busy(Unavailable, f"{count} {self._what} of others are being made")


def _busy(kind: type[ServiceError], why: str) -> ServiceError:
    return kind("busy", f"{why}; try again in {MADE_RETRY_S} s.", retry_after_s=MADE_RETRY_S)
