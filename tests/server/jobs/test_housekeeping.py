"""Housekeeping: removal of expired folds and leftover files."""

import os
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from foldback.server.jobs import housekeeping as module
from foldback.server.settings import Settings
from foldback.server.store.fold_files import EXPORTS_DIR
from foldback.server.store.folds import NoSuchFoldError, Store, new_id
from tests.server.rows import a_movie, add_fold, scans, statements

MIB = 2**20
OLD_S = 2 * module.MIN_DERIVED_AGE_S
"""Age of a file that another client no longer awaits."""
GALLERY: dict[str, Any] = {"public": True, "shape": "wrench-24"}


def housekeeping(store: Store, **settings: object) -> module.Housekeeping:
    data_dir = store.folders.place("any").parents[1]
    return module.Housekeeping(Settings(data_dir=data_dir, **settings), store)  # pyright: ignore


def fold(store: Store, *, days: float, size: int = MIB, **extra: object) -> str:
    """Add a finished fold that was last viewed ``days`` days ago; return its id."""
    then = time.time() - days * module.DAY_S
    usual: dict[str, object] = {"ended_at": then, "visitor": "somebody", "bytes": size}
    row = add_fold(store, **usual | {"created_at": then, "seen_at": then} | extra)
    (store.folders.place(row.id) / "plan.json").write_text("{}")
    return row.id


def derive(store: Store, fold_id: str, size: int, *, age_s: float = OLD_S) -> None:
    """Give a fold an export of ``size`` bytes."""
    path = store.folders.place(fold_id) / EXPORTS_DIR / "fold.csv"
    path.parent.mkdir()
    with open(path, "wb") as file:
        file.truncate(size)
    then = time.time() - age_s
    os.utime(path, (then, then))
    store.add_derived(fold_id, size)


def movie(store: Store, fold_id: str, *, of_owner: bool, age_s: float = OLD_S) -> Path:
    """Add a movie that counts as 1 MiB; return its path."""
    row = a_movie(fold_id, "movie", job=f"{fold_id}.movie.mp4", of_owner=of_owner, bytes=MIB)
    row.created_at -= age_s
    with store.changing() as session:
        session.add(row)
    path = store.folders.place(fold_id) / "movies" / row.file
    path.parent.mkdir()
    path.write_bytes(b"")
    return path


def remaining(store: Store, *folds: str) -> list[bool]:
    """Return True for each fold that still exists; its files must exist only then."""
    answers: list[bool] = []
    for fold_id in folds:
        try:
            store.fold(fold_id)
            answers.append(True)
        except NoSuchFoldError:
            answers.append(False)
        assert store.folders.place(fold_id).exists() == answers[-1]
    return answers


def test_half_written_files_of_killed_processes_are_removed(store: Store) -> None:
    place = store.folders.place(fold(store, days=0))
    (place / EXPORTS_DIR).mkdir()
    names = (".figures.a1b2.partial", f"{EXPORTS_DIR}/.a.csv.1.partial")
    stale, fresh = [place / name for name in names], place / ".plan.json.ff.partial"
    later = place / ".figures.b1.partial"
    tidy = housekeeping(store)
    for paths in ((*stale, fresh), (later,)):  # a process may be killed after the first sweep, too
        for path in paths:
            path.mkdir()
            if path != fresh:
                os.utime(path, (1e9, 1e9))
        os.utime(place, (1e9, 1e9))
        tidy.sweep_orphans()
        assert [path.exists() for path in paths] == [path == fresh for path in paths]
    assert (place / "plan.json").exists()


def test_unseen_folds_expire_when_the_settings_say_so(store: Store) -> None:
    folds = [
        fold(store, days=31),
        fold(store, days=29),
        fold(store, days=31, pinned=True),
        fold(store, days=31, public=True),
        fold(store, days=31, status="queued", ended_at=None),
        fold(store, days=31, status="running", ended_at=None),
    ]
    late, kept_id = (fold(store, days=31) for _ in range(2))
    before = store.fold(late).seen_at
    assert before is not None
    for looked in (late, kept_id):
        store.looked(store.fold(looked))
    assert not store.expire(late, before)
    assert housekeeping(store).sweep() == 0
    assert housekeeping(store, keep_days=30).sweep() == 1
    assert remaining(store, *folds, late, kept_id) == [False, *7 * [True]]


def test_longest_unseen_folds_make_room_and_fresh_ones_stay(store: Store) -> None:
    folds = [fold(store, days=days) for days in (4, 3, 2, 0, 0)]
    folds.append(fold(store, days=9, pinned=True))
    for bound, removed in ((4, 2), (1, 1)):
        assert housekeeping(store, storage_bytes=bound * MIB).sweep() == removed
    assert remaining(store, *folds) == [False, False, False, True, True, True]


def test_storage_of_a_visitor_has_a_bound_of_its_own(store: Store) -> None:
    greedy = [fold(store, days=days, visitor="greedy") for days in (3, 2, 1)]
    modest = fold(store, days=9, visitor="modest")
    assert housekeeping(store, storage_of_visitor_bytes=2 * MIB).sweep() == 1
    assert remaining(store, *greedy, modest) == [False, True, True, True]


def test_cancelled_fold_is_removed_an_hour_after_the_last_look(store: Store) -> None:
    hour = module.CANCELLED_FOLD_S / module.DAY_S
    old, late, pinned, kept_id = (
        fold(store, days=days, status="cancelled", pinned=days > 2 * hour, visitor=f"{days}")
        for days in (1.1 * hour, 0.9 * hour, 3 * hour, 1.2 * hour)
    )
    store.looked(store.fold(kept_id))
    housekeeping(store).sweep()
    assert remaining(store, old, late, pinned, kept_id) == [False, True, True, True]


def test_only_the_latest_cancelled_folds_of_a_visitor_stay(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MAX_CANCELLED_FOLDS", 3)
    folds = [fold(store, days=n / 1e4, size=1, status="cancelled") for n in range(5)]
    other_fold = fold(store, days=0.01, status="cancelled", visitor="another")
    module.limit_cancelled(store, "somebody")
    assert remaining(store, *folds, other_fold) == [True, True, True, False, False, True]
    large = [
        fold(store, days=n / 1e4, size=8 * MIB, status="cancelled", visitor="third")
        for n in range(3)
    ]
    monkeypatch.setattr(module, "MAX_CANCELLED_BYTES", 8 * MIB)
    module.limit_cancelled(store, "third")
    exist = [store.folders.place(name).exists() for name in large]
    assert exist == [True, True, False]  # the last one, and 8 MiB more
    assert sum(store.fold(name).bytes for name in large) == 16 * MIB


def test_sweep_reads_no_rows_that_stay(store: Store) -> None:
    for _ in range(3):
        fold(store, days=1)
    old = [fold(store, days=days, status="cancelled") for days in (1, 2)]
    sweeping = housekeeping(store, keep_days=30)
    with statements() as queries:
        sweeping.sweep()
    assert remaining(store, *old) == [False, False]
    reading = [query for query in queries if "folds" in query[0].lower().split()]
    assert reading
    assert not [line for line in scans(store, reading) if line.startswith("SCAN folds")]
    with statements() as second_statements:
        sweeping.sweep()
    deleted = sum(query[0].startswith("DELETE") for query in queries)
    assert deleted == len(old) and not any(
        sql_statement[0].startswith("DELETE") for sql_statement in second_statements
    )


def test_cancelled_and_repeated_folds_of_the_gallery_are_removed(store: Store) -> None:
    failed: dict[str, Any] = {"status": "failed", "visitor": "another"}
    folds = [
        fold(store, days=1, status="cancelled", **GALLERY),
        fold(store, days=3, **failed, **GALLERY),
    ]
    stay = [
        fold(store, days=1, status="cancelled", pinned=True, **GALLERY),
        fold(store, days=2, **GALLERY),
        fold(store, days=1, **failed, **GALLERY),  # kept: no later fold succeeded
        fold(store, days=3, **failed, **GALLERY, content_key="key"),  # kept: it would fail again
    ]
    housekeeping(store).sweep()
    assert remaining(store, *folds, *stay) == [False, False, True, True, True, True]


def test_derived_files_make_room_before_folds_and_count_for_no_visitor(store: Store) -> None:
    folds = [fold(store, days=days) for days in (3, 2)]
    for name in folds:
        derive(store, name, 2 * MIB)
    movies = [movie(store, folds[0], of_owner=True), movie(store, folds[1], of_owner=False)]
    quota = {"storage_of_visitor_bytes": 2 * MIB}
    housekeeping(store, storage_bytes=8 * MIB, **quota).sweep()
    assert remaining(store, *folds) == [True, True]
    assert [store.fold(name).derived_bytes for name in folds] == [2 * MIB, 2 * MIB]
    housekeeping(store, storage_bytes=7 * MIB, **quota).sweep()
    assert [store.fold(name).derived_bytes for name in folds] == [0, 2 * MIB]
    # The movie that the owner has requested is removed last of all files, then folds.
    for bound, exist in ((3, [True, False]), (2, [False, False])):
        housekeeping(store, storage_bytes=bound * MIB, **quota).sweep()
        assert [path.exists() for path in movies] == exist
    assert [store.fold(name).derived_bytes for name in folds] == [0, 0]
    assert remaining(store, *folds) == [True, True]
    housekeeping(store, storage_bytes=1 * MIB).sweep()
    assert remaining(store, *folds) == [False, True]


def test_derived_bytes_counted_twice_are_corrected_when_room_is_made(store: Store) -> None:
    twice, fresh = fold(store, days=2), fold(store, days=1)
    derive(store, twice, MIB)
    derive(store, fresh, MIB, age_s=0.0)
    made_movie = movie(store, fresh, of_owner=False, age_s=0.0)
    for name in (twice, fresh):  # as if two processes had made the same file
        store.add_derived(name, MIB)
    housekeeping(store, storage_bytes=2 * MIB).sweep()
    assert [store.fold(name).derived_bytes for name in (twice, fresh)] == [0, MIB]
    assert made_movie.exists() and remaining(store, twice, fresh) == [True, True]  # for this client


def test_full_disk_removes_derived_files(store: Store) -> None:
    full = fold(store, days=1)
    derive(store, full, MIB)
    housekeeping(store, min_free_disk_bytes=2**60).sweep()
    assert store.fold(full).derived_bytes == 0
    assert remaining(store, full) == [True]


def test_orphaned_files_are_removed_at_the_second_sweep(store: Store) -> None:
    kept_fold, orphan, fresh = fold(store, days=1), new_id(), new_id()
    for name in (orphan, fresh):
        store.folders.place(name).mkdir()
    before = time.time() - 2 * module.MIN_ORPHAN_AGE_S
    for name in (kept_fold, orphan):
        os.utime(store.folders.place(name), (before, before))
    sweeping = housekeeping(store)
    sweeping.sweep_orphans()
    assert store.folders.place(orphan).exists()
    sweeping.sweep_orphans()
    assert not store.folders.place(orphan).exists()
    assert store.folders.place(fresh).exists()
    assert remaining(store, kept_fold) == [True]


def test_local_copies_of_removed_folds_are_removed(tmp_path: Path, bucket_url: str) -> None:
    settings = Settings(data_dir=tmp_path / "data", storage_url=bucket_url)
    with closing(Store(settings)) as store:
        kept_fold, orphan = fold(store, days=1), new_id()
        copies = {name: settings.cache_dir / f"{name}-1" for name in (kept_fold, orphan)}
        for copy in copies.values():
            copy.mkdir()
        sweeping = module.Housekeeping(settings, store)
        for exists in (True, False):
            sweeping.sweep_orphans()
            assert (copies[kept_fold].exists(), copies[orphan].exists()) == (True, exists)
