"""Leases: locks by which workers are known to live, and rows that describe them.

The kernel or the database releases the lock of a dead worker, so nobody compares clocks. With
PostgreSQL the lock belongs to a session (``server.store.session_lock``). With SQLite all workers
run on one machine, and the lock is that of an open file.
"""

from __future__ import annotations

import os
import secrets
import socket
import time
from collections.abc import Callable, Collection
from fcntl import LOCK_EX, LOCK_NB, LOCK_SH, flock
from importlib.metadata import version
from pathlib import Path
from typing import TypeAlias

import sqlalchemy as sa

from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.schema import WorkerRow, check_sessions
from foldback.server.store.session_lock import SessionLock, held_names


class FileLease:
    """Lease by the lock of a file, which the kernel releases when the process ends.

    Args:
        path: The file. Its name is never used again, so others that ask for the lock, which they
            take for a moment, take it from nobody.

    Attributes:
        descriptor: Descriptor of the open file.
        held: True while the lock is held.
        settled: True if other live workers hold theirs, too.
        queue_poll_s: Time between two checks for waiting jobs, s. A job waits half of it on average
            if there are no notices. A smaller value takes more processor time.
    """

    held = settled = True
    queue_poll_s = 0.1

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(exist_ok=True)
        for other in path.parent.glob("[!.]*"):
            if not _locked(other):
                other.unlink(missing_ok=True)
        unlocked = path.with_name(f".{path.name}")
        self.descriptor = os.open(unlocked, os.O_WRONLY | os.O_CREAT, 0o600)
        flock(self.descriptor, LOCK_EX)
        unlocked.rename(path)


Lease: TypeAlias = FileLease | SessionLock


def new_worker_name() -> str:
    """Return a name for a worker: that of its machine, and a random part."""
    return f"{socket.gethostname()[:100]}/{secrets.token_hex(6)}"


class Leases:
    """Workers of a service. Thread-safe.

    Args:
        settings: The settings.
        store: Store with the rows.
    """

    def __init__(self, settings: Settings, store: Store) -> None:
        self._settings = settings
        self._store = store
        self._on_server = settings.store_url.startswith("postgresql")

    def take(self, name: str, *, on_notice: Callable[[], None]) -> Lease:
        """Begin the lease of a worker; it lasts until the process ends.

        Args:
            name: Name of the worker, which no other one has had.
            on_notice: Called in a thread when a job may wait; never with SQLite.

        Raises:
            PoolerError: If the database's address is that of a pooler.
        """
        if not self._on_server:
            lease = FileLease(self._path(name))
            self._register(name)
            return lease
        url, lease_s = self._settings.store_url, self._settings.lease_s
        check_sessions(url)
        return SessionLock(
            url, name, lease_s, on_taken=lambda: self._register(name), on_notice=on_notice
        )

    def living(self, names: Collection[str]) -> set[str]:
        """Return those of the names that live workers hold."""
        if not names or not self._on_server:
            return {name for name in names if _locked(self._path(name))}
        with self._store.reading() as session:
            return held_names(session.connection(), names)

    def workers(self) -> list[WorkerRow]:
        """Return the live workers."""
        rows = self._store.scalars(sa.select(WorkerRow).order_by(WorkerRow.name))
        living = self.living([row.name for row in rows])
        return [row for row in rows if row.name in living]

    def at_once(self) -> int:
        """Return the number of folds that all live workers compute at the same time."""
        return sum(row.folds_at_once for row in self.workers())

    def _register(self, name: str) -> None:
        """Describe a worker in its row; delete the rows of dead ones.

        Workers that register meanwhile keep theirs.
        """
        names = set(self._store.scalars(sa.select(WorkerRow.name)))
        dead = names - self.living(names)
        row = WorkerRow(
            name=name,
            host=socket.gethostname()[:200],
            pid=os.getpid(),
            folds_at_once=self._settings.folds_per_worker,
            started_at=time.time(),
            version=version("foldback"),
        )
        with self._store.changing() as session:
            session.execute(sa.delete(WorkerRow).where(WorkerRow.name.in_({*dead, name})))
            session.add(row)

    def _path(self, name: str) -> Path:
        return self._settings.root / "workers" / name.rpartition("/")[2]


def _locked(path: Path) -> bool:
    """Return True if a live process holds the lock of a file."""
    try:
        with open(path) as file:
            flock(file, LOCK_SH | LOCK_NB)
    except FileNotFoundError:
        return False
    except BlockingIOError:
        return True
    return False
