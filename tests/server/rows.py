"""Rows for tests without a service."""

import os
import shutil
import threading
import time
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import sqlalchemy as sa
from sqlalchemy import event

from foldback.server.settings import Settings
from foldback.server.store import schema_version
from foldback.server.store.folds import Store, new_id
from foldback.server.store.leases import FileLease, Lease, Leases
from foldback.server.store.owner import Claim, Owner
from foldback.server.store.previews import SWEEPING_THREAD
from foldback.server.store.schema import FoldRow, MovieRow
from tests.server.service_process import Service, wait_until

SOMEBODY = Owner.from_token("a token of somebody")


def a_fold(fold_id: str | None = None, **values: Any) -> FoldRow:
    """Return a row as the service writes it, with some values changed."""
    usual: dict[str, Any] = {
        "id": fold_id or new_id(),
        "name": "a shape",
        "status": "verified",
        "created_at": time.time(),
        "modules": 16,
        "module": "cube",
        "public": False,
        "preset": "default",
        "seed": 0,
        "visitor": "0123456789abcdef0123456789abcdef",
        "cancel_requested": False,
        "progress": {},
        "summary": {},
        "error": None,
    }
    values = usual | values
    return FoldRow(**{"seen_at": values.get("ended_at") or values["created_at"]} | values)


def add_fold(store: Store, **values: Any) -> FoldRow:
    """Add a fold with an empty directory."""
    row = a_fold(**values)
    store.add(row, SOMEBODY)
    store.folders.place(row.id).mkdir()
    return row


def a_movie(fold_id: str, movie_id: str, **values: Any) -> MovieRow:
    """Return a row of a movie, with some values changed."""
    usual: dict[str, Any] = {
        "job": f"{fold_id}-{movie_id}",
        "wishes": {},
        "visitor": "0123456789abcdef0123456789abcdef",
        "token_hash": "",
        "status": "ready",
        "frames_done": 1,
        "problem": None,
        "created_at": time.time(),
    }
    return MovieRow(fold_id=fold_id, id=movie_id, **usual | values)


@contextmanager
def statements() -> Generator[list[tuple[str, Any]]]:
    """Yield the statements that all engines execute, with values, except those of sweeps."""
    executed: list[tuple[str, Any]] = []

    def note(_: Any, __: Any, statement: str, values: Any, *___: Any) -> None:
        if threading.current_thread().name != SWEEPING_THREAD:
            executed.append((statement, values))

    event.listen(sa.Engine, "before_cursor_execute", note)
    try:
        yield executed
    finally:
        event.remove(sa.Engine, "before_cursor_execute", note)


def scans(store: Store, queries: list[tuple[str, Any]]) -> list[str]:
    """Return the tables that SQLite's query plans scan completely; none for other databases."""
    row_ids: list[str] = []
    with store.reading() as session:
        connection = session.connection()
        for statement, values in queries if connection.dialect.name == "sqlite" else ():
            plan = connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {statement}", values)
            row_ids += [line.detail for line in plan if line.detail.startswith("SCAN")]
    return row_ids


NEXT_MIGRATION = """
import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade():
    op.add_column("folds", sa.Column("colour", sa.String(16), server_default="grey"))
    op.execute("UPDATE folds SET colour = status")
"""


@contextmanager
def next_migration(place: Path) -> Iterator[None]:
    """Add a newer version of the tables to those that foldback knows, as a later release does."""
    migrations = shutil.copytree(schema_version.MIGRATIONS, place / "migrations")
    (migrations / "versions" / "0004_colours.py").write_text(NEXT_MIGRATION)
    with patch.object(schema_version, "MIGRATIONS", migrations):
        schema_version.known_versions.cache_clear()
        try:
            yield
        finally:
            schema_version.known_versions.cache_clear()


def store_of(service: Service) -> closing[Store]:
    """Return the store of a service, for a ``with`` statement."""
    return closing(Store(Settings(data_dir=service.data_dir)))


@contextmanager
def live_worker(leases: Leases, name: str) -> Iterator[Lease]:
    """Hold the lease of a worker in this process."""
    lease = leases.take(name, on_notice=lambda: None)
    try:
        wait_until(lambda: lease.held and leases.living([name]))
        yield lease
    finally:
        # As the kernel does when a process ends.
        os.close(lease.descriptor) if isinstance(lease, FileLease) else lease.close()


def new_owner() -> Owner:
    """Return the holder of a new token."""
    return Claim.new().owner
