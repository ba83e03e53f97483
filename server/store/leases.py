"""Leases: which workers live, on all machines.

A worker counts up in its row while it lives. Who looks on and sees the count stand still for as
long as a lease lasts, by a clock of its own that no change of date can move, knows that the worker
is gone. On one machine the locks of ``server.store.worker_identity`` tell it at once.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from importlib.metadata import version

import sqlalchemy as sa

from server.settings import Settings
from server.store.folds import Store, rows_of
from server.store.tables import WorkerRow
from server.store.worker_identity import WorkerIdentities


class Leases:
    """Looks at the workers' rows. Safe to use from many threads.

    Args:
        store: Where the rows are.
        identities: The workers of this machine.
        lease_s: How long a worker may be silent.
        clock: Seconds that only rise.
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
        self._seen: dict[str, tuple[int | None, float]] = {}
        self._looked_at = clock()

    @classmethod
    def of(cls, settings: Settings, store: Store) -> Leases:
        """Those of a service with these settings."""
        return cls(store, WorkerIdentities(settings), settings.lease_s)

    def beat(self, name: str, *, host: str, pid: int, folds_at_once: int) -> None:
        """Says that a worker lives."""
        about = {"host": host, "pid": pid, "folds_at_once": folds_at_once}
        with self._store.changing() as session:
            again = sa.update(WorkerRow).where(WorkerRow.name == name, WorkerRow.pid == pid)
            if rows_of(session.execute(again.values(beat=WorkerRow.beat + 1, **about))):
                return
            # It has just started, or was thought dead and taken out.
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

    def leave(self, name: str) -> None:
        """Says that a worker has ended."""
        with self._store.changing() as session:
            session.execute(sa.delete(WorkerRow).where(WorkerRow.name == name))

    def workers(self) -> list[WorkerRow]:
        """The workers that live, as far as anybody knows."""
        with self._store.reading() as session:
            rows = list(session.scalars(sa.select(WorkerRow).order_by(WorkerRow.name)))
        silent = self._silent({row.name: row.beat for row in rows})
        return [row for row in rows if row.name not in silent]

    def dead(self, holders: Iterable[str]) -> set[str]:
        """The workers that are gone: of those with a row, and of ``holders``, who hold folds.

        It must be asked several times a lease: after a longer pause, as when the database was away
        and nobody's beat could reach it, silence begins anew.
        """
        with self._store.reading() as session:
            rows = session.execute(sa.select(WorkerRow.name, WorkerRow.beat)).all()
        beats: dict[str, int | None] = {row.name: row.beat for row in rows}
        for name in holders:
            beats.setdefault(name, None)
        now = self._clock()
        with self._lock:
            if now - self._looked_at > self._lease_s / 2.0:
                self._seen = {name: (beat, now) for name, (beat, _) in self._seen.items()}
            self._looked_at = now
        return self._silent(beats)

    def at_once(self) -> int:
        """Folds that all living workers compute at once."""
        return sum(row.folds_at_once for row in self.workers())

    def _silent(self, beats: dict[str, int | None]) -> set[str]:
        local = self._identities.dead(beats)
        now = self._clock()
        silent: set[str] = set()
        with self._lock:
            for name, beat in beats.items():
                known = self._seen.get(name)
                if known is None or known[0] != beat:
                    self._seen[name] = (beat, now)
                elif now - known[1] >= self._lease_s:
                    silent.add(name)
            for name in self._seen.keys() - beats.keys():
                del self._seen[name]
        return silent | local
