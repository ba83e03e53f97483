"""Session locks: names that processes hold in PostgreSQL, each by a session of its own.

PostgreSQL releases a lock when its session ends: at once if the process dies, since the kernel
closes the connection, and after a lease without a ping if the process is suspended or cut off.
"""

from __future__ import annotations

import hashlib
import logging
import math
import threading
import time
from collections.abc import Callable, Iterable
from multiprocessing.connection import wait
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.pool import NullPool

from foldback.server.store.schema import JOBS_CHANNEL

CONNECT_S: Final = 5
"""Maximum time to open a session, in s."""
RETRY_S: Final = 0.5
"""Time between two attempts to open a session, or to take a lock that another one holds, in s."""
SETTLE_S: Final = CONNECT_S + 2 * RETRY_S
"""Time, in s, after which all live processes hold their locks again if all sessions have ended at
once, as when PostgreSQL starts again."""
HELD_KEYS: Final = sa.text(
    "SELECT (classid::bigint << 32) | objid::bigint FROM pg_locks "
    "WHERE locktype = 'advisory' AND granted AND objsubid = 1 "
    "AND database = (SELECT oid FROM pg_database WHERE datname = current_database())"
)
log = logging.getLogger("foldback.worker")


class SessionLock:
    """Lock of a name. A thread takes it as soon as it is free, and takes it again after a loss.

    Args:
        url: Address of the database, as in ``Settings.store_url``.
        name: The name.
        lease_s: Time without a ping after which PostgreSQL ends the session, s.
        on_taken: Called in the thread when the lock is taken; an SQLAlchemyError releases it.
        on_notice: Called in the thread when a job may wait in the queue.
    """

    queue_poll_s = 2.0  # notices come at once, but one may be lost with its session

    def __init__(
        self,
        url: str,
        name: str,
        lease_s: float,
        *,
        on_taken: Callable[[], None] = lambda: None,
        on_notice: Callable[[], None] = lambda: None,
    ) -> None:
        self._name, self._lease_s = name, lease_s
        # One session, with the address's password and encryption.
        self._engine = sa.create_engine(
            url,
            poolclass=NullPool,
            isolation_level="AUTOCOMMIT",
            connect_args={"connect_timeout": CONNECT_S, "tcp_user_timeout": int(1000 * lease_s)},
            hide_parameters=True,
        )
        self._on_taken, self._on_notice = on_taken, on_notice
        self._answered_at = self._settled_at = -math.inf
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="session lock", daemon=True)
        self._thread.start()

    @property
    def held(self) -> bool:
        """True if the lock is held. A process that was suspended for a lease sees False."""
        return time.monotonic() - self._answered_at < self._lease_s

    @property
    def settled(self) -> bool:
        """True if the lock is held and, after a loss, other processes had time to take theirs."""
        return self.held and time.monotonic() >= self._settled_at

    def close(self) -> None:
        """Release the lock."""
        self._closing.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                with self._engine.connect() as session:
                    self._hold(session)
            except SQLAlchemyError as error:
                if self._answered_at > -math.inf:
                    self._settled_at = math.inf
                    log.warning("the database has ended the session of %s: %s", self._name, error)
            self._answered_at = -math.inf
            self._closing.wait(RETRY_S)

    def _hold(self, session: sa.Connection) -> None:
        """Take the lock, and keep the session alive until it ends or is closed."""
        connection: Any = session.connection.driver_connection

        def pass_on(_notice: object) -> None:
            self._on_notice()

        connection.add_notify_handler(pass_on)
        limit = f"{int(1000 * self._lease_s)}ms"
        session.execute(sa.select(sa.func.set_config("idle_session_timeout", limit, False)))
        session.exec_driver_sql(f"LISTEN {JOBS_CHANNEL}")
        is_taken = False
        while not self._closing.is_set():
            asked_at = time.monotonic()
            if not is_taken and session.scalar(sa.func.pg_try_advisory_lock(_key(self._name))):
                is_taken = True
                self._on_taken()
                self._settled_at = min(self._settled_at, asked_at + SETTLE_S)
                self._on_notice()  # for jobs that came before
            # Notices arrive at any time, and are read with the next answer.
            session.exec_driver_sql("SELECT 1")
            if is_taken:
                self._answered_at = asked_at
            wait([connection], self._lease_s / 5 if is_taken else RETRY_S)


def held_names(connection: sa.Connection, names: Iterable[str]) -> set[str]:
    """Return those of the names whose locks are held."""
    held_keys = set(connection.scalars(HELD_KEYS))
    return {name for name in names if _key(name) in held_keys}


def _key(name: str) -> int:
    """Return the key of a name's lock, a signed integer of 64 bits."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big", signed=True)
