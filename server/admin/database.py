"""Database of a service for backups: a consistent view, and a transaction that replaces its rows.

A backup contains only rows, so one of SQLite can be restored into PostgreSQL, and the other way
round.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

import sqlalchemy as sa
from sqlalchemy.exc import DatabaseError
from sqlalchemy.pool import NullPool

from foldback.server.admin.errors import AdminError
from foldback.server.store.schema import MIGRATION_LOCK, Base, engine_for, reading_connection

DAMAGE_CODES: Final = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
IN_USE_WORDS: Final = "the database is in use; stop all web processes and workers first."


@contextmanager
def consistent_view(url: str) -> Generator[sa.Connection]:
    """Yield a connection that sees the same rows until it ends, while the service changes them.

    Raises:
        SQLAlchemyError: If the database does not answer.
    """
    with reading_connection(url) as connection:
        if connection.dialect.name == "sqlite":
            connection.exec_driver_sql("BEGIN")
        else:
            connection.execution_options(isolation_level="REPEATABLE READ")
        yield connection


@contextmanager
def replacement(url: str) -> Generator[sa.Connection]:
    """Yield a connection in a transaction that no other process can read or write beside.

    The caller commits the transaction; otherwise nothing changes.

    Args:
        url: Address of the database. A missing SQLite database is created.

    Raises:
        AdminError: If another process uses the database, or a SQLite database is damaged.
        SQLAlchemyError: If the database does not answer or refuses a change.
        OSError: If the SQLite database cannot be created.
    """
    if url.startswith("sqlite"):
        engine = _sqlite_engine(Path(sa.make_url(url).database or ""))
        begin_transaction = _begin_in_sqlite
    else:
        engine = engine_for(url)
        begin_transaction = _begin_in_postgresql
    try:
        with engine.connect() as connection:
            begin_transaction(connection)
            yield connection
    except DatabaseError as error:
        if isinstance(error.orig, sqlite3.Error):
            _check_sqlite_error(error.orig, engine)
        raise
    finally:
        engine.dispose()


def has_schema(connection: sa.Connection) -> bool:
    """Return True if the database has the schema of a service."""
    return bool(_own_names(connection))


def drop_schema(connection: sa.Connection) -> None:
    """Drop the schema of a service, and no other one."""
    meta_data = sa.MetaData()
    meta_data.reflect(connection, only=_own_names(connection))
    meta_data.drop_all(connection)


def _own_names(connection: sa.Connection) -> list[str]:
    own_names = {*Base.metadata.tables, "alembic_version"}
    return sorted(own_names.intersection(sa.inspect(connection).get_table_names()))


def _sqlite_engine(path: Path) -> sa.Engine:
    with suppress(FileExistsError):
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
    return sa.create_engine(
        f"sqlite:///{path}",
        connect_args={"timeout": 1.0},
        poolclass=NullPool,
        hide_parameters=True,
    )


def _begin_in_sqlite(connection: sa.Connection) -> None:
    # Leaving the write-ahead log mode requires that no other process has the database open. The
    # exclusive lock lasts until the connection ends. A killed process leaves an incomplete log,
    # which readers ignore; a rollback journal would be lost on those that read without writing.
    for words in ("journal_mode=DELETE", "locking_mode=EXCLUSIVE", "journal_mode=WAL"):
        connection.exec_driver_sql(f"PRAGMA {words}")
    connection.exec_driver_sql("PRAGMA foreign_keys=ON")
    connection.exec_driver_sql("BEGIN IMMEDIATE")


def _begin_in_postgresql(connection: sa.Connection) -> None:
    connection.exec_driver_sql("SET LOCAL statement_timeout = 0")
    connection.exec_driver_sql("SET LOCAL lock_timeout = 5000")
    # A service that starts meanwhile waits for this lock.
    locked = connection.scalar(sa.select(sa.func.pg_try_advisory_xact_lock(MIGRATION_LOCK)))
    other_clients = connection.exec_driver_sql(
        "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() "
        "AND pid <> pg_backend_pid() AND backend_type = 'client backend'"
    ).scalar()
    if other_clients or not locked:
        raise AdminError(IN_USE_WORDS)


def _check_sqlite_error(error: sqlite3.Error, engine: sa.Engine) -> None:
    """Raise an AdminError if a SQLite database is in use or damaged."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        raise AdminError(IN_USE_WORDS) from None
    if code in DAMAGE_CODES:
        path = engine.url.database
        raise AdminError(
            f"the database {path} is damaged; move it away (mv {path} {path}.damaged), then "
            "restore the backup again."
        ) from None
