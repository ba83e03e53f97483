"""Administration: an operator sees, forgets, keeps and repeats folds, and nothing else happens."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import sqlalchemy as sa
from click.testing import Result
from typer.testing import CliRunner

from planner.readers.gallery import Gallery
from server.api.finished import import_finished
from server.files.cancelled import sweep_cancelled
from server.operate.admin import admin
from server.operate.fold_tasks import AdminTasks
from server.settings import Settings
from server.store.folds import NoSuchFoldError, Store, hash_of
from server.store.tables import FoldRow, MovieRow
from tests.server.rows import a_fold, a_movie
from tests.server.service import SNAKE, Service, over, owner

DAY_S = 86400.0
TOKEN = "a-token-that-must-not-be-seen"


def run(place: Path, *arguments: str, answer: str | None = None) -> Result:
    return CliRunner().invoke(admin, [*arguments, "--data-dir", str(place)], input=answer)


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    """A data directory with a few folds and their files; no service runs on it."""
    settings = Settings(data_dir=tmp_path)
    store = Store(settings)
    now = time.time()
    for fold_id, values in {
        "young": {"status": "verified", "created_at": now - 60.0, "bytes": 1234},
        "old": {"status": "failed", "created_at": now - 9 * DAY_S},
        "looked": {"created_at": now - 9 * DAY_S, "seen_at": now - 60.0},
        "pinned": {"created_at": now - 9 * DAY_S, "pinned": True},
        "shown": {"created_at": now - 9 * DAY_S, "public": True, "shape": "mallet-64"},
        "waits": {"status": "queued", "created_at": now - 30.0, "name": "x\n\x1b[31m"},
    }.items():
        store.add(a_fold(fold_id, **values), TOKEN)
        (tmp_path / "folds" / fold_id).mkdir()
        (tmp_path / "folds" / fold_id / "input").touch()
    store.close()
    yield tmp_path


def ids(place: Path, *arguments: str) -> list[str]:
    found = run(place, "list", "--json", *arguments)
    assert found.exit_code == 0, found.output
    return [row["id"] for row in json.loads(found.stdout)]


def test_folds_are_listed_the_oldest_first(place: Path) -> None:
    assert set(ids(place)[:4]) == {"old", "looked", "pinned", "shown"}
    assert ids(place)[4:] == ["young", "waits"]
    assert ids(place, "--status", "queued") == ["waits"]
    assert set(ids(place, "--older", "5")) == {"old", "pinned", "shown"}
    table = run(place, "list").stdout.splitlines()
    assert table[0].split()[:3] == ["id", "status", "stage"]
    assert next(line for line in table if line.startswith("pinned")).endswith("pinned")
    assert next(line for line in table if line.startswith("old")).split()[3:5] == ["9", "d"]
    assert "0123456789abcdef" not in "".join(table), "of a visitor only a few letters are shown"
    assert run(place, "list", "--status", "nonsense").exit_code == 2


def test_a_fold_is_shown_without_what_lets_its_reader_in(place: Path) -> None:
    found = run(place, "show", "waits")
    assert found.exit_code == 0
    assert all(line.isprintable() for line in found.stdout.splitlines())
    shown = json.loads(run(place, "show", "waits", "--json").stdout)
    assert (shown["status"], shown["owner"], shown["job"]) == ("queued", True, "queued")
    assert shown["name"] == "x\n\x1b[31m"
    assert len(shown["visitor"]) == 8
    assert TOKEN not in found.stdout and "token" not in shown
    missing = run(place, "show", "nowhere")
    assert missing.exit_code == 1 and "There is no fold" in missing.stderr


def test_what_is_old_is_forgotten_and_what_shall_stay_stays(place: Path) -> None:
    assert run(place, "expire", "--older", "5", answer="n\n").exit_code == 1
    assert "old" in ids(place)
    done = run(place, "expire", "--older", "5", answer="y\n")
    assert done.exit_code == 0, done.output
    assert set(ids(place)) == {"looked", "pinned", "shown", "young", "waits"}
    assert not (place / "folds" / "old").exists()
    assert run(place, "expire", "--older", "5", "--yes").stdout == "Nothing to delete.\n"
    assert run(place, "expire").exit_code == 2
    assert run(place, "expire", "young", "--older", "1").exit_code == 2


def test_one_that_is_refused_does_not_keep_the_others(place: Path) -> None:
    done = run(place, "expire", "--yes", "pinned", "nowhere", "shown", "young")
    assert done.exit_code == 1
    assert "pinned is pinned and is not deleted" in done.stderr
    assert "belongs to the gallery" in done.stderr
    assert "no fold 'nowhere'" in done.stderr
    assert "young is deleted" in done.stdout
    assert {"pinned", "shown"} <= set(ids(place))
    assert run(place, "expire", "--yes", "--force", "pinned").exit_code == 0
    assert not (place / "folds" / "pinned").exists()


def test_what_is_pinned_can_be_let_go(place: Path) -> None:
    assert run(place, "pin", "old").exit_code == 0
    assert "old" in set(ids(place, "--older", "5"))
    assert run(place, "expire", "old", "--yes").exit_code == 1
    assert run(place, "unpin", "old").exit_code == 0
    assert run(place, "expire", "old", "--yes").exit_code == 0
    assert run(place, "pin", "old").exit_code == 1


def test_ids_never_become_paths(place: Path) -> None:
    beside = place / "beside"
    beside.mkdir()
    for fold_id in ("../beside", "..", "/etc"):
        assert run(place, "expire", "--yes", "--force", fold_id).exit_code == 1
    assert beside.exists()


def test_a_fold_is_queued_again_and_begins_anew(place: Path) -> None:
    (place / "folds" / "old" / "request.json").write_text("{}")
    (place / "folds" / "old" / "timeline.zarr").mkdir()
    (place / "folds" / "old" / "plan.json").touch()
    store = Store(Settings(data_dir=place))
    with store.changing() as session:
        session.add(a_movie("old", "m1"))
    done = run(place, "requeue", "old")
    assert done.exit_code == 0, done.output
    shown = json.loads(run(place, "show", "old", "--json").stdout)
    assert (shown["status"], shown["epoch"], shown["job"]) == ("queued", 1, "queued")
    assert (shown["error"], shown["ended_at"], shown["stage"]) == (None, None, None)
    assert {p.name for p in (place / "folds" / "old").iterdir()} == {"input", "request.json"}
    with store.reading() as session:
        assert session.scalars(sa.select(MovieRow)).all() == []  # they were of what came out before
    store.close()
    again = run(place, "requeue", "old")
    assert again.exit_code == 1 and "waits in the queue" in again.stderr
    refused = run(place, "requeue", "young")
    assert refused.exit_code == 1 and "is verified" in refused.stderr
    waiting = run(place, "requeue", "waits")
    assert waiting.exit_code == 1 and "waits in the queue" in waiting.stderr


def test_a_fold_whose_files_a_sweeper_removes_is_not_queued_again(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (place / "folds" / "old" / "request.json").write_text("{}")
    store, admin_tasks = Store(Settings(data_dir=place)), AdminTasks(Settings(data_dir=place))
    cancelled = sa.update(FoldRow).values(status="cancelled", bytes=1)
    with store.changing() as session:
        session.execute(cancelled.where(FoldRow.id == "old"))
    remove = store.folders.remove

    def meanwhile(fold_id: str) -> None:
        with pytest.raises(NoSuchFoldError):
            admin_tasks.requeue(fold_id)
        remove(fold_id)

    monkeypatch.setattr(store.folders, "remove", meanwhile)
    sweep_cancelled(store, time.time())
    with pytest.raises(NoSuchFoldError):
        store.fold("old")
    assert not (place / "folds" / "old").exists()
    admin_tasks.close()
    store.close()


def test_no_worker_lives_where_none_was_started(place: Path) -> None:
    assert run(place, "workers").stdout == "No worker is running.\n"
    assert json.loads(run(place, "workers", "--json").stdout) == []


def test_where_no_service_was_nothing_is_made(tmp_path: Path) -> None:
    found = run(tmp_path / "nowhere", "list")
    assert found.exit_code == 1
    assert "no database" in found.stderr
    assert not (tmp_path / "nowhere").exists()


def test_tables_of_another_version_are_left_alone(place: Path) -> None:
    engine = sa.create_engine(f"sqlite:///{place / 'foldback.db'}")
    with engine.begin() as connection:
        connection.execute(sa.text("UPDATE alembic_version SET version_num = '0002'"))
    engine.dispose()
    found = run(place, "list")
    assert found.exit_code == 1
    assert "version 0002, expected 0013" in found.stderr
    (place / "foldback.db").write_bytes(b"garbage\n" * 1000)
    found = run(place, "list")
    assert found.exit_code == 1 and "foldback doctor" in found.stderr


def test_a_cancelled_fold_is_computed_after_all(service: Service) -> None:
    fold = service.fold(SNAKE, seed="4711")
    service.http.post(f"/api/folds/{fold['id']}/cancel", headers=owner(fold))
    cancelled = service.wait(fold["id"], over)
    admin_tasks = AdminTasks(Settings(data_dir=service.data_dir))
    try:
        before = admin_tasks.fold(fold["id"]).epoch
        admin_tasks.requeue(fold["id"], force=cancelled["status"] == "verified")
        assert service.wait(fold["id"], over)["status"] == "verified"
        row: FoldRow = admin_tasks.fold(fold["id"])
        assert row.epoch >= before + 2
        assert row.owner == hash_of(fold["owner_token"])
        assert [worker.pid for worker in admin_tasks.workers()]
    finally:
        admin_tasks.close()


@pytest.mark.long
def test_damaged_lists_folds_with_changed_files(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    store = Store(settings)
    import_finished(settings, store, Gallery())
    assert run(tmp_path, "damaged").exit_code == 0
    fold_id = store.list_public()[0].id
    (store.directory(fold_id) / "plan.json").write_text("{}")
    store.close()
    found = run(tmp_path, "damaged")
    assert found.exit_code == 1
    assert f"{fold_id}" in found.stdout and "plan.json" in found.stdout
    assert len(found.stdout.splitlines()) == 2
