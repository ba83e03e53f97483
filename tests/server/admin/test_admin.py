"""Administration: an operator lists, deletes, pins and requeues folds, without side effects."""

import json
import os
import time
from contextlib import closing
from pathlib import Path

import pytest
import sqlalchemy as sa
from click.testing import Result
from typer.testing import CliRunner

from foldback.planner.readers.gallery import Gallery
from foldback.server.admin.fold_tasks import AdminTasks
from foldback.server.cli.admin import admin
from foldback.server.jobs.housekeeping import Housekeeping
from foldback.server.settings import Settings
from foldback.server.store.folds import NoSuchFoldError, Store
from foldback.server.store.leases import Leases
from foldback.server.store.owner import Owner
from foldback.server.store.schema import FoldRow, MovieRow
from foldback.server.submission.shipped_folds import import_shipped_folds
from tests.server.rows import a_fold, a_movie, live_worker

DAY_S = 86400.0
TOKEN = "a-token-that-must-not-be-seen"


def run(place: Path, *arguments: str, answer: str | None = None) -> Result:
    return CliRunner().invoke(admin, [*arguments, "--data-dir", str(place)], input=answer)


@pytest.fixture
def place(tmp_path: Path, store: Store) -> Path:
    """Data directory with a few folds and their files; no service runs on it."""
    now = time.time()
    for fold_id, values in {
        "young": {"status": "verified", "created_at": now - 60.0, "bytes": 1234},
        "old": {"status": "failed", "created_at": now - 9 * DAY_S},
        "looked": {"created_at": now - 9 * DAY_S, "seen_at": now - 60.0},
        "pinned": {"created_at": now - 9 * DAY_S, "pinned": True},
        "shown": {"created_at": now - 9 * DAY_S, "public": True, "shape": "mallet-64"},
        "waits": {"status": "queued", "created_at": now - 30.0, "name": "x\n\x1b[31m"},
    }.items():
        store.add(a_fold(fold_id, **values), Owner.from_token(TOKEN))
        (tmp_path / "folds" / fold_id).mkdir()
        (tmp_path / "folds" / fold_id / "input").touch()
    return tmp_path


def ids(place: Path, *arguments: str) -> list[str]:
    listed_rows = run(place, "list", "--json", *arguments)
    assert listed_rows.exit_code == 0, listed_rows.output
    return [row["id"] for row in json.loads(listed_rows.stdout)]


def test_folds_are_listed_from_the_oldest(place: Path) -> None:
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


def test_shown_fold_hides_its_token(place: Path) -> None:
    shown_row = run(place, "show", "waits")
    assert shown_row.exit_code == 0
    assert all(line.isprintable() for line in shown_row.stdout.splitlines())
    row_values = json.loads(run(place, "show", "waits", "--json").stdout)
    assert (row_values["status"], row_values["owner"], row_values["job"]) == (
        "queued",
        True,
        "queued",
    )
    assert row_values["name"] == "x\n\x1b[31m"
    assert len(row_values["visitor"]) == 8
    assert TOKEN not in shown_row.stdout and "token" not in row_values
    missing = run(place, "show", "nowhere")
    assert missing.exit_code == 1 and "There is no fold" in missing.stderr


def test_old_folds_are_deleted_unless_pinned(place: Path) -> None:
    assert run(place, "expire", "--older", "5", answer="n\n").exit_code == 1
    assert "old" in ids(place)
    done = run(place, "expire", "--older", "5", answer="y\n")
    assert done.exit_code == 0, done.output
    assert set(ids(place)) == {"looked", "pinned", "shown", "young", "waits"}
    assert not (place / "folds" / "old").exists()
    assert run(place, "expire", "--older", "5", "--yes").stdout == "Nothing to delete.\n"
    assert run(place, "expire").exit_code == 2
    assert run(place, "expire", "young", "--older", "1").exit_code == 2


def test_pinned_gallery_and_unknown_folds_are_not_deleted(place: Path) -> None:
    beside = place / "beside"
    beside.mkdir()
    done = run(place, "expire", "--yes", "pinned", "nowhere", "../beside", "..", "shown", "young")
    assert done.exit_code == 1
    for words in ("pinned is pinned, so it is not deleted", "belongs to the gallery", "'nowhere'"):
        assert words in done.stderr
    assert "young is deleted" in done.stdout
    assert {"pinned", "shown"} <= set(ids(place)) and beside.exists()
    assert run(place, "expire", "--yes", "--force", "../beside").exit_code == 1
    assert run(place, "expire", "--yes", "--force", "pinned").exit_code == 0
    assert not (place / "folds" / "pinned").exists() and beside.exists()
    assert run(place, "pin", "old").exit_code == 0
    assert "old" in set(ids(place, "--older", "5"))
    assert run(place, "expire", "old", "--yes").exit_code == 1
    assert run(place, "unpin", "old").exit_code == 0
    assert run(place, "expire", "old", "--yes").exit_code == 0
    assert run(place, "pin", "old").exit_code == 1


def test_requeued_fold_begins_anew(place: Path, store: Store) -> None:
    (place / "folds" / "old" / "request.json").write_text("{}")
    (place / "folds" / "old" / "timeline").mkdir()
    (place / "folds" / "old" / "plan.json").touch()
    with store.changing() as session:
        session.add(a_movie("old", "m1"))
    done = run(place, "requeue", "old")
    assert done.exit_code == 0, done.output
    row_values = json.loads(run(place, "show", "old", "--json").stdout)
    assert (row_values["status"], row_values["epoch"], row_values["job"]) == ("queued", 1, "queued")
    assert (row_values["error"], row_values["ended_at"], row_values["stage"]) == (None, None, None)
    assert {p.name for p in (place / "folds" / "old").iterdir()} == {"input", "request.json"}
    with store.reading() as session:
        assert session.scalars(sa.select(MovieRow)).all() == []  # old movies are gone
    for name, words in (
        ("old", "waits in the queue"),
        ("young", "is verified"),
        ("waits", "waits in the queue"),
    ):
        requeued = run(place, "requeue", name)
        assert (requeued.exit_code, words in requeued.stderr) == (1, True)


def test_fold_that_is_being_removed_is_not_requeued(
    place: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    (place / "folds" / "old" / "request.json").write_text("{}")
    with store.changing() as session:
        cancelled = sa.update(FoldRow).values(status="cancelled", bytes=1)
        session.execute(cancelled.where(FoldRow.id == "old"))
    remove = store.folders.remove
    with closing(AdminTasks(Settings(data_dir=place))) as admin_tasks:

        def meanwhile(fold_id: str) -> None:
            with pytest.raises(NoSuchFoldError):
                admin_tasks.requeue(fold_id)
            remove(fold_id)

        monkeypatch.setattr(store.folders, "remove", meanwhile)
        Housekeeping(Settings(data_dir=place), store).remove_cancelled()
    with pytest.raises(NoSuchFoldError):
        store.fold("old")
    assert not (place / "folds" / "old").exists()


def test_workers_are_listed_and_bad_databases_reported(
    place: Path, store: Store, tmp_path: Path
) -> None:
    assert run(place, "workers").stdout == "No worker is running.\n"
    with live_worker(Leases(Settings(data_dir=place), store), "one"):
        (worker,) = json.loads(run(place, "workers", "--json").stdout)
    assert (worker["name"], worker["pid"]) == ("one", os.getpid())
    nowhere = tmp_path / "nowhere"
    refused_run = run(nowhere, "list")
    assert (refused_run.exit_code, "no database" in refused_run.stderr) == (1, True)
    assert not nowhere.exists()
    nowhere.mkdir()
    (nowhere / "foldback.db").write_bytes(b"garbage\n" * 1000)
    refused_run = run(nowhere, "list")
    assert (refused_run.exit_code, "foldback doctor" in refused_run.stderr) == (1, True)


@pytest.mark.long
def test_damaged_lists_folds_with_changed_files(tmp_path: Path, store: Store) -> None:
    import_shipped_folds(Settings(data_dir=tmp_path), store, Gallery())
    assert run(tmp_path, "damaged").exit_code == 0
    fold_id = store.list_public()[0].id
    (store.directory(fold_id) / "plan.json").write_text("{}")
    refused_run = run(tmp_path, "damaged")
    assert refused_run.exit_code == 1
    assert fold_id in refused_run.stdout and "plan.json" in refused_run.stdout
    assert len(refused_run.stdout.splitlines()) == 2
