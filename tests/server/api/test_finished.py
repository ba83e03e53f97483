"""Finished folds that come with the package."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
import sqlalchemy as sa

from planner.pipeline import manifest
from planner.plan.packed import unpack
from planner.readers.gallery import Gallery
from planner.verification.verify import verify
from server.api.finished import FINISHED_FOLDS_DIR, import_finished
from server.pages.cards import included_folds
from server.settings import Settings
from server.store.folds import Store
from server.store.tables import CounterRow

NAMES = sorted(path.stem for path in FINISHED_FOLDS_DIR.glob("*.fold"))
SMALL = "tetra-cube-2"


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Settings, Store]]:
    settings = Settings(data_dir=tmp_path_factory.mktemp("finished"))
    store = Store(settings)
    assert list(import_finished(settings, store, Gallery())) == NAMES
    yield settings, store
    store.close()


def test_finished_folds_are_five_and_hold_files_as_they_were_certified(
    imported: tuple[Settings, Store],
) -> None:
    store = imported[1]
    rows = store.list_public()
    assert len(rows) == len(NAMES) == 5
    assert {row.module for row in rows} == {"cube", "tetrahedron"}
    assert [row.refold for row in rows if row.refold] == ["wrench-80"]
    assert {(row.status, row.visitor, row.bytes, row.pinned) for row in rows} == {
        ("verified", "the service itself", 0, True)
    }
    assert sum(path.stat().st_size for path in FINISHED_FOLDS_DIR.glob("*.fold")) < 1_600_000
    for row in rows:
        assert manifest.changed_fields(store.directory(row.id)) == [], row.name


def test_second_import_of_finished_folds_brings_nothing(imported: tuple[Settings, Store]) -> None:
    settings, store = imported
    gone = next(row for row in store.list_public() if row.refold)
    assert store.delete(gone.id)
    assert import_finished(settings, store, Gallery()) == []
    assert len(included_folds(store)) == 4


def test_import_skips_damaged_finished_folds_and_those_that_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "finished"
    folder.mkdir()
    (folder / f"{SMALL}.fold").symlink_to(FINISHED_FOLDS_DIR / f"{SMALL}.fold")
    (folder / "broken.fold").write_bytes(b"no archive")
    monkeypatch.setattr("server.api.finished.FINISHED_FOLDS_DIR", folder)
    settings = Settings(data_dir=tmp_path / "data")
    with closing(Store(settings)) as store:
        assert import_finished(settings, store, Gallery()) == [SMALL]
        assert "the finished fold broken could not be imported" in caplog.text
        with store.changing() as session:  # as if it had been folded here
            session.execute(sa.delete(CounterRow).where(CounterRow.name == f"finished {SMALL}"))
        assert import_finished(settings, store, Gallery()) == []
        (row,) = store.list_public()
        assert [path.name for path in settings.folds_dir.iterdir()] == [row.id]


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_finished_fold_verifies_again(name: str, tmp_path: Path) -> None:
    unpack((FINISHED_FOLDS_DIR / f"{name}.fold").read_bytes(), tmp_path)
    found = verify(tmp_path)
    assert (found.problems, found.notes) == ((), ())
