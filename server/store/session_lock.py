"""Session locks: names that processes hold in PostgreSQL, each by a session of its own.

PostgreSQL releases a lock when its session ends: at once if the process dies, since the kernel
closes the connection, and after a lease without a ping if the process is suspended or cut off.
"""

from __future__ import annotations

import hashlib
import logging
import select
import socket
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any, Final

import psycopg
import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from foldback.server.store.schema import JOBS_CHANNEL

MAX_RETRY_S: Final = 0.5
"""Maximum time between two attempts to reach PostgreSQL, or to take a lock that another session
holds, in s."""
HELD_KEYS: Final = sa.text(
    "SELECT array_agg((classid::bigint << 32) | objid::bigint), "
    "extract(epoch FROM now() - pg_postmaster_start_time())::float "
    "FROM pg_locks WHERE locktype = 'advisory' AND granted AND objsubid = 1 "
    "AND database = (SELECT oid FROM pg_database WHERE datname = current_database())"
)
"""Keys of all locks that sessions hold, and the seconds since the start of PostgreSQL."""
log = logging.getLogger("foldback.worker")


class SessionLock:
    """Lock of a name. A thread takes it as soon as it is free, and takes it again after a loss.

    Args:
        url: Address of the database, as in ``Settings.store_url``.
        name: The name.
        lease_s: Time without a ping after which PostgreSQL ends the session, s.
        on_taken: Called in the thread when the lock is taken; an SQLAlchemyError releases it.
        on_lost: Called in the thread after a loss.
        on_notice: Called in the thread when a job may wait in the queue.
    """

    def __init__(
        self,
        url: str,
        name: str,
        lease_s: float,
        *,
        on_taken: Callable[[], None] = lambda: None,
        on_lost: Callable[[], None] = lambda: None,
        on_notice: Callable[[], None] = lambda: None,
    ) -> None:
        self._url = url
        self._name = name
        self._lease_s = lease_s
        self._on_taken = on_taken
        self._on_lost = on_lost
        self._on_notice = on_notice
        self._taken = threading.Event()
        self._closing = threading.Event()
        self._closed_end, self._open_end = socket.socketpair()
        self._answered_at = 0.0
        self._thread = threading.Thread(target=self._run, name="session lock", daemon=True)
        self._thread.start()

    @property
    def held(self) -> bool:
        """True if the lock is held. A process that was suspended for a lease sees False."""
        return self._taken.is_set() and time.monotonic() - self._answered_at < self._lease_s

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until the lock is taken; return False on a timeout."""
        return self._taken.wait(timeout_s)

    def close(self) -> None:
        """Release the lock."""
        self._closing.set()
        self._closed_end.close()
        self._thread.join()
        self._open_end.close()

    def _run(self) -> None:
        is_logged = False
        while not self._closing.is_set():
            try:
                with _connection(self._url, self._lease_s) as session:
                    self._hold(session)
            except (psycopg.Error, SQLAlchemyError) as error:
                if self._taken.is_set() or not is_logged:
                    log.warning("no lock of %s in the database: %s", self._name, error)
                is_logged = True
            if self._taken.is_set():
                self._taken.clear()
                if not self._closing.is_set():
                    self._on_lost()
            self._closing.wait(min(MAX_RETRY_S, self._lease_s / 5))

    def _hold(self, session: psycopg.Connection) -> None:
        """Take the lock, and keep the session alive until it ends or is closed."""
        session.execute(
            "SELECT set_config('idle_session_timeout', %s, false)", (str(_ms(self._lease_s)),)
        )
        session.add_notify_handler(lambda _: self._on_notice())
        session.execute(f"LISTEN {JOBS_CHANNEL}".encode())
        waiting = select.poll()
        for end in (session, self._open_end):
            waiting.register(end, select.POLLIN)
        while not self._closing.is_set():
            asked_at = time.monotonic()
            # Its answer also brings the notices.
            session.execute("SELECT 1")
            self._answered_at = asked_at
            if not self._taken.is_set() and _take(session, self._name):
                self._on_taken()
                self._taken.set()
                self._on_notice()  # for jobs that came before
            pause_s = self._lease_s / 5
            waiting.poll(_ms(pause_s if self._taken.is_set() else min(pause_s, MAX_RETRY_S)))


def held_names(connection: sa.Connection, names: Iterable[str], lease_s: float) -> set[str]:
    """Return those of the names whose locks are held.

    These are all if PostgreSQL has started less than a lease ago: its start has ended all sessions,
    and processes that live need a moment to take their locks again.
    """
    keys, uptime_s = connection.execute(HELD_KEYS).one()
    if 0.0 <= uptime_s < lease_s:
        return set(names)
    held = set[int](keys or ())
    return {name for name in names if _key_of(name) in held}


def is_pooled(url: str) -> bool:
    """Return True if a pooler gives each transaction another session, so that locks are lost."""
    with _connection(url) as first, _connection(url) as second:
        pid = _pid(first)
        with second.transaction():
            return _pid(second) == pid or _pid(first) != pid


def _connection(url: str, lease_s: float = 15.0) -> psycopg.Connection:
    """Open a connection of its own, which fails on this side, too, if it is cut off for a lease."""
    parts = sa.make_url(url)
    _, options = parts.get_dialect()().create_connect_args(parts)
    limits: dict[str, Any] = {"connect_timeout": 5, "tcp_user_timeout": _ms(lease_s)}
    return psycopg.connect(**{**limits, **options}, autocommit=True)


def _take(session: psycopg.Connection, name: str) -> bool:
    row = session.execute("SELECT pg_try_advisory_lock(%s)", (_key_of(name),)).fetchone()
    return row is not None and bool(row[0])


def _pid(session: psycopg.Connection) -> int:
    row = session.execute("SELECT pg_backend_pid()").fetchone()
    assert row is not None
    return int(row[0])


def _key_of(name: str) -> int:
    """Return the key of a name's lock, a signed integer of 64 bits."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big", signed=True)


def _ms(seconds: float) -> int:
    return int(1000.0 * seconds)
