"""Leases: detection of live and expired workers on all machines.

A live worker increments the counter in its row. If the counter does not change for the duration of
a lease, measured by the observer's monotonic clock, the worker has expired. On the same machine the
locks of ``server.store.worker_identity`` show this at once.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from importlib.metadata import version

import sqlalchemy as sa

from foldback.server.settings import Settings
from foldback.server.store.folds import Store, rows_of
from foldback.server.store.schema import WorkerRow
from foldback.server.store.worker_identity import WorkerIdentities


class Leases:
    """Rows of the workers. Thread-safe.

    Args:
        store: Store with the rows.
        identities: The workers of this machine.
        lease_s: Time without a heartbeat after which a worker counts as dead, s.
        clock: Monotonic clock in seconds.
    """

    def __init__(
        self,
        store: Store,
        identities: WorkerIdentities,
        lease_s: float,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._store = store
        self._identities = identities
        self._lease_s = lease_s
        self._clock = clock
        self._lock = threading.Lock()
        self._beats: dict[str, tuple[int | None, float]] = {}
        self._looked_at = clock()

    @classmethod
    def of(cls, settings: Settings, store: Store) -> Leases:
        """Return the leases of a service with these settings."""
        return cls(store, WorkerIdentities(settings), settings.lease_s)

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
