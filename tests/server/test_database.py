"""The tables that migrations make are those that the code expects."""

from __future__ import annotations

from pathlib import Path

import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext

from server.database import Base, engine_for, migrate


def test_migrations_lead_to_the_tables_of_the_code(tmp_path: Path) -> None:
    engine = engine_for(f"sqlite:///{tmp_path / 'rows.db'}")
    migrate(engine)
    migrate(engine)  # nothing is left to do, and that is no error
    with engine.connect() as connection:
        differences = compare_metadata(
            MigrationContext.configure(connection, opts={"compare_type": True}), Base.metadata
        )
        assert not differences
        assert connection.execute(sa.text("PRAGMA journal_mode")).scalar() == "wal"
        assert connection.execute(sa.text("PRAGMA foreign_keys")).scalar() == 1
    engine.dispose()
