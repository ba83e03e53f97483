"""Tables: migrations lead from the first schema to that of the code, and lose nothing."""

import hashlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext

from foldback.server.cli.serve import server_of
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.owner import Owner
from foldback.server.store.schema_version import NewerSchemaError, Schema
from foldback.server.store.tables import STATUSES, Base, FoldRow, engine_for, migrate
from foldback.words.fold import RUNNING_STATUSES
from tests.server.postgres import DATABASES
from tests.server.rows import a_fold, new_owner, upgrade

TOKEN = "a-token-that-somebody-got-long-ago"
OWNER = Owner.from_token(TOKEN)


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
"""Values of the first version's folds that differ from the usual ones, by their status."""


def first_folds() -> list[dict[str, Any]]:
    """Return rows as the first version wrote them: one of each status, and unusual values."""
    assert set(UNUSUAL) == set(STATUSES)
    usual = {
        **{"name": "a shape", "stage": "explode", "modules": 16, "module": "cube", "shape": None},
        **{"public": False, "preset": "default", "seed": 0, "module_size": None, "error": None},
        **{"created_at": 1.7e9 + 0.125, "started_at": 1.7e9 + 1.5, "ended_at": 1.7e9 + 60.25},
        **{"visitor": "0123456789abcdef0123456789abcdef", "cancel_requested": False},
        **{"progress": {}, "summary": {}},
    }
    return [
        {**usual, "id": f"{status}2345678901234"[:20], "status": status, "content_key": status * 4}
        | values
        for status, values in UNUSUAL.items()
    ]


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


def write(connection: sa.Connection, **rows: list[dict[str, Any]]) -> None:
    """Write rows into the existing tables; JSON columns get JSON, where None is null."""
    found = sa.MetaData()
    found.reflect(connection)
    for name, values in rows.items():
        table = found.tables[name]
        for column in ("progress", "summary", "error", "wishes"):
            if column in table.c:
                table.c[column].type = sa.JSON()
        connection.execute(sa.insert(table), values)


@contextmanager
def migrated(engine: sa.Engine, url: str, tmp_path: Path) -> Iterator[Store]:
    """Migrate an older database and yield its store."""
    with closing(Store(Settings(data_dir=tmp_path, database_url=url))) as store:
        yield store
    with engine.connect() as connection:
        assert not Schema.of(connection).missing


def test_first_schema_is_migrated_with_all_its_rows(
    engine: sa.Engine, url: str, tmp_path: Path
) -> None:
    upgrade(engine, "0001")
    folds = first_folds()
    token_hash = hashlib.sha256(TOKEN.encode()).hexdigest()
    owners = [
        {"fold_id": fold["id"], "token_hash": token_hash, "created_at": fold["created_at"]}
        for fold in folds
    ]
    with engine.begin() as connection:
        write(connection, folds=folds, owners=owners)
        assert len(Schema.of(connection).missing) == len(Schema.of(connection).known) - 1
    with migrated(engine, url, tmp_path) as store:
        for fold in folds:
            row = store.fold(fold["id"])
            # The keys of folds have changed, except those of the gallery.
            key = fold["content_key"] if fold["public"] else None
            assert {name: getattr(row, name) for name in fold} == fold | {"content_key": key}
            assert row.owner == row.maker == OWNER.digest and not row.renamed
            assert store.owns(row.id, OWNER) != row.public
            assert not store.owns(row.id, new_owner())
            assert (row.refold, row.smooths, row.worker, row.resumed_at) == (None, None, None, None)
            assert (row.seen_at, row.pauses) == (fold["ended_at"] or fold["created_at"], 0)
            assert (row.turn, row.cost_s, row.epoch, row.kept) == (0, 0.0, 0, 0)
            # The bytes of a cancelled fold were not counted; one byte makes the sweep visit it.
            assert (row.bytes, row.derived_bytes) == (row.status == "cancelled", 0)
            assert row.pinned is False
        assert [row.shape for row in store.list_public()] == ["mallet-64"]
        assert sorted(row.status for row in store.list_owned(OWNER)) == sorted(STATUSES)
        with store.reading() as session:
            unfinished = FoldRow.status.in_(RUNNING_STATUSES)
            found = set(session.scalars(sa.select(FoldRow.status).where(unfinished)))
        assert found == {"queued", "running"}
        assert store.ahead(store.fold(folds[0]["id"]))[0] == 1
        new = a_fold("new", created_at=1.8e9, content_key=hashlib.sha256(b"new").hexdigest())
        assert store.add(new, OWNER)
        assert not store.add(a_fold("twin", content_key=new.content_key), OWNER)


def verified_fold(name: str, verdict: str = "verified", **values: Any) -> dict[str, Any]:
    """Return the row of a verified fold, with some values changed."""
    verified = next(fold for fold in first_folds() if fold["status"] == "verified")
    summary = {"status": "verified", "reason": "", "certificate": {"verdict": verdict}}
    return {**verified, "id": name, "content_key": name, "summary": summary, **values}


def test_migration_keeps_the_first_owner_counts_movies_apart_and_fails_gaps(
    engine: sa.Engine, url: str, tmp_path: Path
) -> None:
    upgrade(engine, "0005")
    reason = "2 moments could not be bounded"
    folds = [
        verified_fold("mine", public=False, bytes=1000),
        verified_fold("open", public=True, bytes=5),
        verified_fold("gaps", f"verified with gaps: {reason}", bytes=1),
    ]
    movie = {
        **{"id": "movie", "wishes": {}, "visitor": "v", "token_hash": "", "status": "ready"},
        **{"frames_done": 1, "problem": None, "created_at": 1.0, "bytes": 400},
    }
    shown = [fold["id"] for fold in folds[:2]]
    owners = [
        {"fold_id": fold_id, "token_hash": Owner.from_token(token).digest, "created_at": at}
        for fold_id in shown
        for token, at in ((TOKEN, 1.0), ("a-stranger-who-had-the-link-only", 2.0))
    ]
    movies = [{**movie, "fold_id": fold_id, "job": fold_id} for fold_id in shown]
    with engine.begin() as connection:
        write(connection, folds=folds, owners=owners, movies=movies)
    with migrated(engine, url, tmp_path) as store:
        mine, public, gaps = (store.fold(fold["id"]) for fold in folds)
    assert (mine.owner, mine.content_key, mine.bytes) == (OWNER.digest, None, 600)
    assert (public.owner, public.content_key, public.bytes) == (None, "open", 0)
    assert (mine.status, mine.error) == ("verified", None)
    assert (gaps.status, gaps.summary["status"]) == ("failed", "failed")
    assert gaps.error == {"code": "not-verified", "detail": reason, "where": None}
    assert gaps.summary["reason"] == reason


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
        assert Schema.of(connection).found == "0099"
        assert Schema.of(connection).newer
    engine.dispose()
    with pytest.raises(SystemExit) as ended:
        server_of(Settings(data_dir=tmp_path))
    assert ended.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("The service does not start: got a database with tables of version 0099")
