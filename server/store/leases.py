"""Leases: detection of live and expired workers on all machines.

A live worker increments the counter in its row. If the counter does not change for the duration of
a lease, measured by the observer's monotonic clock, the worker has expired. On the same machine the
locks of ``server.store.worker_identity`` show this at once.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import version
from operator import attrgetter
from typing import Final

import sqlalchemy as sa
from cachetools import TTLCache, cachedmethod

from foldback.planner.compilation.compiling_lock import IMPORTS_FRACTION
from foldback.server.settings import Settings
from foldback.server.store.folds import Store, rows_of
from foldback.server.store.schema import CounterRow, WorkerRow
from foldback.server.store.worker_identity import WorkerIdentities

COMPILED_COUNT: Final = 1000
"""Scale of the counter that holds the compiled fraction of a worker's numerical kernels in the
database, as an integer in thousandths: the value once all are compiled."""
MIN_COMPILED_FRACTION: Final = IMPORTS_FRACTION
"""Compiled fraction of a worker's numerical kernels from which on the remaining time is
extrapolated."""
COMPILING_CACHE_S: Final = 0.4
"""Time for which the compiled fraction of the workers' numerical kernels is cached, in s."""
SERVICE_START_S: Final = 60.0
"""Time after the start of the service for which missing workers count as starting rather than as
failed, in s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compilation:
    """Progress of the workers while none of them can compute yet.

    Attributes:
        fraction: Compiled fraction of the kernels of the most advanced worker, 0 to 1.
        remaining_s: Estimated seconds until it can compute; None if unknown.
    """

    fraction: float
    remaining_s: float | None


def _compilation_key(name: str) -> str:
    """Return the name of the counter with a worker's compiled fraction."""
    return f"compilation {sha256(name.encode()).hexdigest()[:20]}"


class Leases:
    """Rows of the workers. Thread-safe.

    Args:
        store: Store with the rows.
        identities: The workers of this machine.
        lease_s: Time without a heartbeat after which a worker counts as dead, s.
        clock: Monotonic clock in seconds.
        expects_workers: True if workers start with this process.
    """

    def __init__(
        self,
        store: Store,
        identities: WorkerIdentities,
        lease_s: float,
        *,
        clock: Callable[[], float] = time.monotonic,
        expects_workers: bool = False,
    ) -> None:
        self._store = store
        self._identities = identities
        self._lease_s = lease_s
        self._clock = clock
        self._lock = threading.Lock()
        self._beats: dict[str, tuple[int | None, float]] = {}
        self._looked_at = clock()
        self._made_at = clock()
        self._expects_workers = expects_workers
        self._cached_compilation: TTLCache[tuple[()], Compilation | None] = TTLCache(
            1, COMPILING_CACHE_S, timer=clock
        )

    @classmethod
    def of(cls, settings: Settings, store: Store) -> Leases:
        """Return the leases of a service with these settings."""
        identities = WorkerIdentities(settings)
        return cls(store, identities, settings.lease_s, expects_workers=settings.workers > 0)

    def heartbeat(self, name: str, *, host: str, pid: int, folds_at_once: int) -> None:
        """Increment the heartbeat counter of a worker."""
        about = {"host": host, "pid": pid, "folds_at_once": folds_at_once}
        with self._store.changing() as session:
            update = sa.update(WorkerRow).where(WorkerRow.name == name, WorkerRow.pid == pid)
            if rows_of(session.execute(update.values(beat=WorkerRow.beat + 1, **about))):
                return
            # It has just started, or another process took it for dead and deleted its row.
            session.execute(sa.delete(WorkerRow).where(WorkerRow.name == name))
            session.add(
                WorkerRow(
                    name=name,
                    beat=1,
                    started_at=time.time(),
                    version=version("foldback"),
                    **about,
                )
            )

    def deregister(self, name: str) -> None:
        """Deregister a worker."""
        with self._store.changing() as session:
            session.execute(sa.delete(WorkerRow).where(WorkerRow.name == name))
            session.execute(sa.delete(CounterRow).where(CounterRow.name == _compilation_key(name)))

    def note_compilation(self, name: str, fraction: float | None) -> None:
        """Store the compiled fraction of a worker's kernels, 0 to 1; None if it is ready."""
        with self._store.changing() as session:
            session.execute(sa.delete(CounterRow).where(CounterRow.name == _compilation_key(name)))
            if fraction is not None:
                value = round(COMPILED_COUNT * min(max(fraction, 0.0), 1.0))
                session.add(CounterRow(name=_compilation_key(name), value=value))

    def compilation(self) -> Compilation | None:
        """Return the progress of the workers' compilation; None if one can compute.

        Callers share one query per ``COMPILING_CACHE_S``.
        """
        return self._read_compilation()

    @cachedmethod(attrgetter("_cached_compilation"), lock=attrgetter("_lock"))
    def _read_compilation(self) -> Compilation | None:
        workers = self.workers()
        if not workers:
            starting = self._expects_workers and self._clock() - self._made_at < SERVICE_START_S
            return Compilation(fraction=0.0, remaining_s=None) if starting else None
        keys = {_compilation_key(row.name): row for row in workers}
        rows = self._store.scalars(sa.select(CounterRow).where(CounterRow.name.in_(keys)))
        if len(rows) < len(workers):
            return None
        best = max(rows, key=lambda row: row.value)
        fraction, spent_s = best.value / COMPILED_COUNT, time.time() - keys[best.name].started_at
        is_known = fraction >= MIN_COMPILED_FRACTION and spent_s > 0.0
        left_s = spent_s * (1.0 - fraction) / fraction if is_known else None
        return Compilation(fraction=fraction, remaining_s=left_s)

    def workers(self) -> list[WorkerRow]:
        """Return the workers that are not known to be dead."""
        rows = list(self._store.scalars(sa.select(WorkerRow).order_by(WorkerRow.name)))
        silent = self._silent({row.name: row.beat for row in rows})
        return [row for row in rows if row.name not in silent]

    def expired(self, holders: Iterable[str]) -> set[str]:
        """Return the expired workers among those with a row and ``holders`` of folds.

        Call this several times per lease. After a longer pause the leases start again, because the
        database may have been unavailable for heartbeats as well.
        """
        rows = self._store.rows(sa.select(WorkerRow.name, WorkerRow.beat))
        beats: dict[str, int | None] = {row.name: row.beat for row in rows}
        for name in holders:
            beats.setdefault(name, None)
        now = self._clock()
        with self._lock:
            if now - self._looked_at > self._lease_s / 2.0:
                self._beats = {name: (beat, now) for name, (beat, _) in self._beats.items()}
            self._looked_at = now
        return self._silent(beats)

    def at_once(self) -> int:
        """Return the number of folds that all live workers compute at the same time."""
        return sum(row.folds_at_once for row in self.workers())

    def _silent(self, beats: dict[str, int | None]) -> set[str]:
        local = self._identities.dead(beats)
        now = self._clock()
        silent: set[str] = set()
        with self._lock:
            for name, beat in beats.items():
                last_beat = self._beats.get(name)
                if last_beat is None or last_beat[0] != beat:
                    self._beats[name] = (beat, now)
                elif now - last_beat[1] >= self._lease_s:
                    silent.add(name)
            for name in self._beats.keys() - beats.keys():
                del self._beats[name]
        return silent | local
