"""Concurrency quotas: limits on concurrent use, in total, per visitor and per network.

Three rules divide a quota:

- A visitor holds at most ``per_visitor`` permits, and each network around it
  (``server.limits.networks``) at most half of the total.
- When the total is reached, a newcomer displaces the newest permit of the network that holds the
  most, provided that this network then still holds no fewer than the newcomer's network.
- Waiting permits become active in turn: round-robin among networks, and among the visitors of a
  network.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Generator
from contextlib import contextmanager
from enum import StrEnum
from typing import Any, Final

from foldback.server.errors import ServiceError, TooMany, Unavailable
from foldback.server.limits.networks import networks_of

OPEN_RETRY_S: Final = 10
"""Value of the ``Retry-After`` header, in s, of the refusal if too many event streams, uploads or
target streams are open. With a smaller value clients return sooner, and more of
them are refused again."""
BUSY_RETRY_S: Final = 5
"""Value of the ``Retry-After`` header, in s, if a request is refused because too many others wait
to be processed. A smaller value brings more requests that are refused again."""


class Holder(StrEnum):
    """Holder of the permits that fill a quota, in the words of a refusal."""

    VISITOR = "of yours"
    NETWORK = "from your network"
    ALL = "in all"


class Permit:
    """Permit of a quota, until it is returned or displaced.

    Attributes:
        visitor: Its holder; None for operators and proxies.
        displaced: True once a newcomer has displaced it.
    """

    def __init__(
        self,
        quota: Quota,
        visitor: str | None,
        start: Callable[[Permit], object],
        end: Callable[[], object] | None,
    ) -> None:
        self._quota = quota
        self.visitor = visitor
        self.groups = () if visitor is None else (*networks_of(visitor), visitor)
        self.site = self.groups[0] if self.groups else None
        self.start = start
        self.end = end
        self.going = False
        self.held = True
        self.displaced = False

    def leave(self) -> None:
        """Return the permit; a second call does nothing."""
        self._quota.leave(self)

    def __enter__(self) -> Permit:
        return self

    def __exit__(self, *of: object) -> None:
        self.leave()


class Quota:
    """Permits in use. Thread-safe.

    Args:
        what: Name of what the permits are for, in the plural.
        total: Maximum number of permits, including waiting ones; None for no limit.
        per_visitor: Maximum number of permits of one visitor; operators have no such limit.
        at_once: Maximum number of active permits; the others wait. None for no limit.
        at_once_per_visitor: Maximum number of active permits of one visitor; None for no limit.
            If it is set, one network leaves at least one active permit to others.
        timeout_s: Maximum wait in ``turn``, s.
        refuse: Creates the error for a full quota from the number of permits and their holder.
    """

    def __init__(
        self,
        subject: str,
        *,
        total: int | None,
        per_visitor: int,
        at_once: int | None = None,
        at_once_per_visitor: int | None = None,
        timeout_s: float = 10.0,
        refuse: Callable[[int, Holder], ServiceError] | None = None,
    ) -> None:
        self._subject = subject
        self._total = total
        self._per_visitor = per_visitor
        self._per_network = network_share(total, per_visitor)
        self._at_once = at_once
        self._at_once_per_visitor = at_once_per_visitor
        self._timeout_s = timeout_s
        self._refuse = refuse or (self._too_many if at_once is None else self._too_busy)
        self._lock = threading.Lock()
        self._count = self._going_count = 0
        self._permit_counts: Counter[str] = Counter()
        """Number of permits of each visitor and each network."""
        self._going: Counter[str] = Counter()
        self._line: OrderedDict[str | None, OrderedDict[str | None, deque[Permit]]] = OrderedDict()
        """Waiting permits by widest network and visitor; the least recently served comes first."""
        self._displaceable: dict[str, dict[Permit, None]] = {}
        """Permits that a newcomer may displace, by visitor, the oldest first."""

    def __len__(self) -> int:
        """Return the number of permits that are held."""
        return self._count

    def enter(
        self,
        visitor: str | None,
        start: Callable[[Permit], object] = lambda permit: None,
        *,
        end: Callable[[], object] | None = None,
    ) -> Permit:
        """Return a new permit.

        Args:
            visitor: Its holder.
            start: Called with the permit when it becomes active; must not block.
            end: Called when a newcomer displaces the permit; must not block, and may be called in
                another thread. Without it a permit is never displaced. If ``at_once`` is set,
                active permits are never displaced.

        Raises:
            ServiceError: If the quota is full.
        """
        permit = Permit(self, visitor, start, end)
        with self._lock:
            victim = self._check(permit)
            if victim is not None:
                victim.displaced = True
                self._remove(victim)
            self._count += 1
            self._permit_counts.update(permit.groups)
            visitors = self._line.setdefault(permit.site, OrderedDict())
            visitors.setdefault(visitor, deque()).append(permit)
            if end is not None and visitor is not None:
                self._displaceable.setdefault(visitor, {})[permit] = None
            self._admit()
        if victim is not None and victim.end is not None:
            victim.end()
        return permit

    @contextmanager
    def turn(self, visitor: str, *, unwanted: Callable[[], bool] | None = None) -> Generator[None]:
        """Wait for a visitor's turn, which lasts as long as the context.

        Args:
            visitor: The visitor.
            unwanted: Polled during the wait; the wait ends once it returns True.

        Raises:
            ServiceError: If the quota is full, the wait takes too long or is no longer wanted, or
                a visitor of another network has displaced the permit.
        """
        started = threading.Event()
        with self.enter(visitor, lambda _: started.set(), end=started.set) as permit:
            deadline = time.monotonic() + self._timeout_s
            while not started.wait(min(0.1, self._timeout_s)):
                if unwanted is not None and unwanted():
                    raise Unavailable("gone", "Cancelled, because the client disconnected.")
                if time.monotonic() >= deadline:
                    raise _busy(Unavailable, f"Other {self._subject} are being created")
            if permit.displaced:
                raise self._refuse(self._count, Holder.ALL)
            yield

    def leave(self, permit: Permit) -> None:
        """Return a waiting or active permit."""
        with self._lock:
            if permit.held:
                self._remove(permit)
                self._admit()

    def _check(self, newcomer: Permit) -> Permit | None:
        """Return the permit that a newcomer displaces; None if the quota is not full.

        Raises:
            ServiceError: If the quota is full and no permit may be displaced.
        """
        if newcomer.groups:
            own_held = self._permit_counts[newcomer.groups[-1]]
            if own_held >= self._per_visitor:
                raise self._refuse(own_held, Holder.VISITOR)
        full, holder = self._full_group(newcomer)
        if holder is None:
            return None
        victim = self._victim(newcomer, full)
        if victim is None:
            count = self._count if full is None else self._permit_counts[full]
            raise self._refuse(count, holder)
        return victim

    def _full_group(self, newcomer: Permit) -> tuple[str | None, Holder | None]:
        """Return the narrowest full network around a newcomer, or ALL if the total is reached."""
        for network in reversed(newcomer.groups[:-1]):
            if self._per_network is not None and self._permit_counts[network] >= self._per_network:
                return network, Holder.NETWORK
        full = self._total is not None and self._count >= self._total
        return None, Holder.ALL if full else None

    def _victim(self, newcomer: Permit, network: str | None) -> Permit | None:
        """Return the permit that a newcomer displaces, if there is one.

        Args:
            newcomer: The permit for which the quota is full.
            network: The network whose limit is reached; None for the total.
        """
        heaviest: tuple[tuple[int, ...], Permit] | None = None
        for permits in self._displaceable.values():
            permit = next(reversed(permits))
            if network is not None and network not in permit.groups:
                continue
            apart = _first_difference(permit.groups, newcomer.groups)
            if apart is None:
                continue
            own_held = (
                self._permit_counts[newcomer.groups[apart]] if apart < len(newcomer.groups) else 0
            )
            if self._permit_counts[permit.groups[apart]] <= own_held + 1:
                continue
            weight = tuple(self._permit_counts[group] for group in permit.groups)
            if heaviest is None or weight > heaviest[0]:
                heaviest = weight, permit
        return None if heaviest is None else heaviest[1]

    def _remove(self, permit: Permit) -> None:
        """Remove a permit; the caller holds the lock."""
        permit.held = False
        self._count -= 1
        self._permit_counts.subtract(permit.groups)
        if permit.going:
            self._going_count -= 1
            self._going.subtract(permit.groups)
        else:
            self._leave_line(permit)
        for counts in (self._permit_counts, self._going):
            for group in permit.groups:
                if not counts[group]:
                    del counts[group]
        self._forget_displaceable(permit)

    def _forget_displaceable(self, permit: Permit) -> None:
        if permit.visitor in self._displaceable:
            permits = self._displaceable[permit.visitor]
            permits.pop(permit, None)
            if not permits:
                del self._displaceable[permit.visitor]

    def _admit(self) -> None:
        """Activate the permits whose turn has come; the caller holds the lock."""
        while self._at_once is None or self._going_count < self._at_once:
            permit = self._next()
            if permit is None:
                return
            self._going_count += 1
            self._going.update(permit.groups)
            permit.going = True
            if self._at_once is not None:
                self._forget_displaceable(permit)
            permit.start(permit)

    def _next(self) -> Permit | None:
        """Remove the next permit from the waiting ones and return it."""
        for site, visitors in self._line.items():
            for visitor, waiting in visitors.items():
                permit = waiting[0]
                if self._may_begin(permit):
                    visitors.move_to_end(visitor)
                    self._line.move_to_end(site)
                    self._leave_line(permit)
                    return permit
        return None

    def _leave_line(self, permit: Permit) -> None:
        visitors = self._line[permit.site]
        visitors[permit.visitor].remove(permit)
        if not visitors[permit.visitor]:
            del visitors[permit.visitor]
        if not visitors:
            del self._line[permit.site]

    def _may_begin(self, permit: Permit) -> bool:
        max_of_visitor = self._at_once_per_visitor
        if max_of_visitor is None or self._at_once is None or not permit.groups:
            return True
        *networks, visitor = permit.groups
        share = max(max_of_visitor, self._at_once - 1)
        return self._going[visitor] < max_of_visitor and all(
            self._going[n] < share for n in networks
        )

    def _too_many(self, count: int, holder: Holder) -> TooMany:
        return TooMany(
            f"too-many-{self._subject.replace(' ', '-')}",
            f"{{count}} {self._subject} {holder} are active, which is the limit; end one, or try "
            "again in {retry_after_s} s.",
            retry_after_s=OPEN_RETRY_S,
            count=count,
        )

    def _too_busy(self, count: int, holder: Holder) -> ServiceError:
        if holder is Holder.ALL:
            reason = f"{{count}} {self._subject} for other people are being created"
            return _busy(Unavailable, reason, count=count)
        return _busy(TooMany, f"{{count}} {self._subject} {holder} are being created", count=count)


def network_share(total: int | None, per_visitor: int) -> int | None:
    """Return the number of permits that one network may hold; None for no limit."""
    # a network of addresses may take half
    return None if total is None else max(per_visitor, total // 2)


def _first_difference(first: tuple[str, ...], second: tuple[str, ...]) -> int | None:
    """Return the index of the first group that two visitors do not share; None if none."""
    for k, group in enumerate(first):
        if k >= len(second) or group != second[k]:
            return k
    return None


def _busy(kind: type[ServiceError], reason: str, **values: Any) -> ServiceError:
    template = f"{reason}; try again in {{retry_after_s}} s."
    return kind("busy", template, retry_after_s=BUSY_RETRY_S, **values)
