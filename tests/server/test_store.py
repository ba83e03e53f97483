"""Rows of folds: who may end them, and that an end is the end."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from server.database import FoldRow
from server.settings import Settings
from server.store import NoSuchFoldError, Store, new_id, new_token


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    store = Store(Settings(data_dir=tmp_path))
    yield store
    store.close()


def row(key: str | None = None, **more: object) -> FoldRow:
    values: dict[str, object] = {
        "id": new_id(),
        "name": "snake",
        "status": "queued",
        "created_at": time.time(),
        "modules": 16,
        "module": "cube",
        "public": False,
        "preset": "default",
        "seed": 0,
        "content_key": key,
        "visitor": "somebody",
        "cancel_requested": False,
        "progress": {},
        "summary": {},
    }
    return FoldRow(**{**values, **more})


def test_ids_cannot_be_guessed_and_never_name_another_place(store: Store) -> None:
    ids = {new_id() for _ in range(1000)}
    assert len(ids) == 1000
    assert {len(i) for i in ids} == {20}
    for bad in ("", "..", "a/b", "a.b", "é", "a" * 33, "a\n"):
        with pytest.raises(NoSuchFoldError):
            store.directory(bad)


def test_a_content_key_is_taken_once(store: Store) -> None:
    first, second = row("key"), row("key")
    assert store.add(first, new_token())
    assert not store.add(second, new_token())
    found = store.find("key")
    assert found is not None
    assert found.id == first.id


def test_an_end_is_the_end(store: Store) -> None:
    fold = row("key")
    store.add(fold, new_token())
    assert store.begin(fold.id, "read")
    assert store.finish(fold.id, "verified", summary={"status": "verified"})
    assert store.finish(fold.id, "failed", summary={}, repeatable=False)
    assert store.fold(fold.id).status == "verified"
    assert not store.begin(fold.id, "explode")
    store.request_cancel(fold.id)
    assert store.fold(fold.id).status == "verified"


def test_a_cancelled_fold_is_not_begun_and_frees_its_key(store: Store) -> None:
    queued, running = row("a"), row("b")
    for fold in (queued, running):
        store.add(fold, new_token())
    store.begin(running.id, "explode")
    assert store.report(running.id, {"fraction": 0.5})
    for fold in (queued, running):
        store.request_cancel(fold.id)
    assert store.fold(queued.id).status == "cancelled"
    assert not store.begin(queued.id, "read")
    assert not store.report(running.id, {"fraction": 0.6})
    assert not store.report(running.id)
    assert store.find("a") is None
    assert store.find("b") is None


def test_claims(store: Store) -> None:
    fold, first, second = row(), new_token(), new_token()
    store.add(fold, first)
    store.claim(fold.id, second)
    store.claim(fold.id, second)
    assert store.owners(fold.id) == 2
    assert store.owns(fold.id, first)
    assert not store.owns(fold.id, new_token())
    assert [r.id for r in store.list_owned(second)] == [fold.id]
    assert store.release(fold.id, first) == 1
    assert not store.owns(fold.id, first)
    store.delete(fold.id)
    with pytest.raises(NoSuchFoldError):
        store.fold(fold.id)
    assert not store.finish(fold.id, "verified", summary={})


def test_places_in_the_queue(store: Store) -> None:
    folds = [row(created_at=float(i)) for i in range(3)]
    for fold in folds:
        store.add(fold, new_token())
    assert [store.queue_position(f) for f in folds] == [1, 2, 3]
    store.begin(folds[0].id, "read")
    assert [store.queue_position(store.fold(f.id)) for f in folds] == [0, 1, 2]
    assert store.waiting() == 3
    assert store.waiting(visitor="nobody") == 0
