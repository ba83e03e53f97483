"""Tables: migrations lead to the schema of the code, and lose nothing."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext

from foldback.server.cli.serve import server_of
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.schema import STATUSES, Base, FoldRow, engine_for, migrate
from foldback.server.store.schema_version import NewerSchemaError, Schema
from tests.server.postgres import DATABASES
from tests.server.rows import next_migration


@pytest.fixture(params=DATABASES)
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """URL of an empty database."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'rows.db'}"
    return request.getfixturevalue("postgres").database()


@pytest.fixture
def engine(url: str) -> Iterator[sa.Engine]:
    engine = engine_for(url)
    yield engine
    engine.dispose()


UNUSUAL: dict[str, dict[str, Any]] = {
    "queued": {"stage": None, "started_at": None, "ended_at": None},
    "running": {
        "ended_at": None,
        "module_size": 0.9,
        "progress": {"message": "größer", "steps": 10},
    },
    "verified": {
        **{"name": "wrench ✓", "shape": "mallet-64", "public": True},
        "summary": {"status": "verified", "certificate": {"pairs": [1, 2.5]}},
    },
    "failed": {
        "seed": 2**53 - 1,
        "error": {"code": "crossing", "detail": "Cells 3 and 9 touch.", "where": "cell 3"},
    },
    "cancelled": {"content_key": None, "cancel_requested": True},
}
"""Values of folds that differ from the usual ones, by their status."""


USUAL: dict[str, Any] = {
    **{"name": "a shape", "stage": "explode", "modules": 16, "module": "cube", "shape": None},
    **{"public": False, "preset": "default", "seed": 0, "module_size": None, "error": None},
    **{"created_at": 1.7e9 + 0.125, "started_at": 1.7e9 + 1.5, "ended_at": 1.7e9 + 60.25},
    **{"visitor": "0123456789abcdef0123456789abcdef", "cancel_requested": False},
    **{"progress": {}, "summary": {}, "seen_at": 1.7e9 + 70.5, "pinned": True},
}


def test_migrations_lead_to_the_tables_of_the_code(engine: sa.Engine) -> None:
    migrate(engine)
    migrate(engine)  # a second migration does nothing
    with engine.connect() as connection:
        differences = compare_metadata(
            MigrationContext.configure(connection, opts={"compare_type": True}), Base.metadata
        )
        assert not differences
        if engine.dialect.name == "sqlite":
            assert connection.execute(sa.text("PRAGMA journal_mode")).scalar() == "wal"
            assert connection.execute(sa.text("PRAGMA foreign_keys")).scalar() == 1


def test_next_migration_keeps_all_rows(engine: sa.Engine, url: str, tmp_path: Path) -> None:
    rows = [{**USUAL, "id": name, "status": name} | values for name, values in UNUSUAL.items()]
    assert set(UNUSUAL) == set(STATUSES)
    settings = Settings(data_dir=tmp_path, database_url=url)
    with closing(Store(settings)) as store, store.changing() as session:
        session.add_all(FoldRow(**row) for row in rows)
    with next_migration(tmp_path):
        with engine.connect() as connection:
            assert Schema.of(connection).missing == ("0004",)
        with closing(Store(settings)) as store:
            for row in rows:
                stored = store.fold(row["id"])
                assert {name: getattr(stored, name) for name in row} == row
        with engine.connect() as connection:
            assert not Schema.of(connection).missing
            colours = connection.execute(sa.text("SELECT id, colour FROM folds")).all()
        assert sorted(colours) == sorted((name, name) for name in STATUSES)
    with engine.connect() as connection:
        assert Schema.of(connection).newer
    with pytest.raises(NewerSchemaError, match="version 0004, expected 0003 at most"):
        migrate(engine)


def test_newer_database_is_refused_and_unchanged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    engine = engine_for(f"sqlite:///{tmp_path / 'foldback.db'}")
    migrate(engine)
    with engine.begin() as connection:
        connection.execute(sa.text("UPDATE alembic_version SET version_num = '0099'"))
    with pytest.raises(NewerSchemaError, match="version 0099, expected .* at most. A newer"):
        migrate(engine)
    with engine.connect() as connection:
        assert Schema.of(connection).version == "0099"
        assert Schema.of(connection).newer
    engine.dispose()
    with pytest.raises(SystemExit) as ended:
        server_of(Settings(data_dir=tmp_path))
    assert ended.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("The service does not start: got a database of version 0099")
