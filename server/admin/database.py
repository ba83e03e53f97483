"""Database of a service: dump, checks, and restoration.

SQLite is copied by its backup API, PostgreSQL by its own programs. These get passwords in the
environment instead of the command line, which other users of the machine can read.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
from contextlib import closing
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Final

import sqlalchemy as sa
from psycopg.conninfo import conninfo_to_dict, make_conninfo
from psycopg.pq import Conninfo

from planner.files import written_aside
from server.admin.errors import AdminError
from server.settings import VARIABLE_PREFIX
from server.store.tables import reading_connection

SECRET_PREFIXES: Final = (VARIABLE_PREFIX, "AWS_", "PG")
"""Prefixes of the environment variables that PostgreSQL's programs do not inherit from this
process, because they may contain secrets or select another database."""
LOG_SUFFIXES: Final = ("-wal", "-shm", "-journal")
"""Suffixes of the files that SQLite creates next to a database."""


@dataclass(frozen=True, slots=True)
class Database:
    """Address of a service's database, including its password."""

    url: str

    @property
    def is_sqlite(self) -> bool:
        """True for SQLite, False for PostgreSQL."""
        return self.url.startswith("sqlite")

    @property
    def path(self) -> Path:
        """File of a SQLite database."""
        return Path(sa.make_url(self.url).database or "")

    @property
    def file(self) -> str:
        """Name of its file in a backup; the suffix depends on the kind of database."""
        return "rows.sqlite" if self.is_sqlite else "rows.dump"

    def dump(self, target: Path) -> None:
        """Write a consistent copy into an existing file, while the service runs.

        Raises:
            AdminError: If PostgreSQL's program is missing or failed.
            SQLAlchemyError: If the SQLite database cannot be read.
        """
        if self.is_sqlite:
            with reading_connection(self.url) as read, closing(sqlite3.connect(target)) as copy:
                connection = read.connection.driver_connection
                assert isinstance(connection, sqlite3.Connection)
                connection.backup(copy)
                copy.execute("PRAGMA journal_mode=DELETE")
        else:
            self._run("pg_dump", "--format=custom", "--no-owner", "--no-acl", f"--file={target}")

    def is_empty(self) -> bool:
        """Return True if the database has no tables or does not exist."""
        if self.is_sqlite:
            return not self.path.exists()
        with reading_connection(self.url) as connection:
            return not self._tables(connection)

    def check_unused(self) -> None:
        """Refuse a database that another process has open.

        Raises:
            AdminError: If it is open elsewhere.
        """
        if self.is_sqlite:
            used = self.path.exists() and _is_open(self.path)
        else:
            query = (
                "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() "
                "AND pid <> pg_backend_pid() AND backend_type = 'client backend'"
            )
            with reading_connection(self.url) as connection:
                used = bool(connection.exec_driver_sql(query).scalar())
        if used:
            raise AdminError("the database is in use; stop all web processes and workers first.")

    def restore(self, source: BufferedReader) -> None:
        """Replace the content of the database with a dump.

        Raises:
            AdminError: If PostgreSQL's program is missing or failed.
            OSError: If the SQLite database cannot be written.
        """
        if self.is_sqlite:
            self._restore_sqlite(source)
            return
        with reading_connection(self.url) as connection:
            for name in self._tables(connection):
                connection.exec_driver_sql(f"DROP TABLE {name} CASCADE")
            connection.commit()
        name = make_conninfo(dbname=sa.make_url(self.url).database or "")
        options = ("--no-owner", "--no-acl", "--single-transaction", "--exit-on-error")
        self._run("pg_restore", *options, f"--dbname={name}", source=source)

    def _restore_sqlite(self, source: BufferedReader) -> None:
        with written_aside(self.path) as aside:
            with open(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
                shutil.copyfileobj(source, file)
            for suffix in LOG_SUFFIXES:
                self.path.with_name(self.path.name + suffix).unlink(missing_ok=True)

    @staticmethod
    def _tables(connection: sa.Connection) -> list[str]:
        """Return the quoted names of PostgreSQL's tables."""
        quote = connection.dialect.identifier_preparer.quote
        return [quote(name) for name in sa.inspect(connection).get_table_names()]

    def _run(self, program: str, *arguments: str, source: BufferedReader | None = None) -> None:
        path = shutil.which(program)
        if path is None:
            raise AdminError(
                f"the program {program} is missing; install PostgreSQL's client programs, in the "
                "server's version or a newer one (Debian: apt install postgresql-client)."
            )
        inherited = {k: v for k, v in os.environ.items() if not k.startswith(SECRET_PREFIXES)}
        done = subprocess.run(
            [path, "--no-password", *arguments],
            env=inherited | _variables(self.url),
            stdin=source or subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            said = done.stderr.strip().partition("\n")[0]
            raise AdminError(f"{program} ended with the exit code {done.returncode}: {said}")


def _variables(url: str) -> dict[str, str]:
    """Return the parts of an address as variables of PostgreSQL's programs."""
    plain = sa.make_url(url).set(drivername="postgresql")
    parts = conninfo_to_dict(plain.render_as_string(hide_password=False))
    names = {
        option.keyword.decode(): option.envvar.decode()
        for option in Conninfo.get_defaults()
        if option.envvar
    }
    return {names[key]: str(value) for key, value in parts.items() if key in names}


def _is_open(path: Path) -> bool:
    """Return True if another process has a SQLite database open.

    Leaving the write-ahead log mode requires exclusive access to the database.
    """
    try:
        with closing(sqlite3.connect(path, timeout=1.0)) as connection:
            connection.execute("PRAGMA journal_mode=DELETE")
    except sqlite3.DatabaseError as error:
        return "locked" in str(error)  # a damaged database may be replaced
    return False
