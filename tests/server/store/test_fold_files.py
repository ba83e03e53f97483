"""Files of folds on two machines that share a storage: what one has kept the other shows."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from server.settings import Settings
from server.store import fold_files
from server.store.fold_files import MIN_COPY_AGE_S, Folders
from server.store.object_store import StorageError, open_storage
from server.store.tables import FoldRow

FOLD = "a1"


@pytest.fixture
def machines(bucket_url: str, tmp_path: Path) -> tuple[Folders, Folders]:
    """Where a fold is computed, and where it is read."""
    here, there = (
        Folders(Settings(data_dir=tmp_path / name, storage_url=bucket_url, cache_bytes=2**20))
        for name in ("here", "there")
    )
    (tmp_path / "aside").mkdir()
    (tmp_path / "aside" / "input").write_bytes(b"cells")
    here.adopt(tmp_path / "aside", FOLD)
    return here, there


def row(kept: int, status: str = "running") -> FoldRow:
    return FoldRow(id=FOLD, kept=kept, status=status)


def test_files_kept_under_an_epoch_are_shown_elsewhere(
    machines: tuple[Folders, Folders], monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = machines
    work = here.bring(FOLD, 0, 1)
    assert (work / "input").read_bytes() == b"cells"
    (work / "frames").write_bytes(b"one")
    here.keep(FOLD, 1)
    copy = there.shown(row(1))
    assert (copy / "frames").read_bytes() == b"one"
    assert there.copied() == {FOLD}

    # What still grows is looked at again after a moment, what is over never.
    (work / "frames").write_bytes(b"more")
    here.keep(FOLD, 1)
    assert (there.shown(row(1)) / "frames").read_bytes() == b"one"
    monkeypatch.setattr(fold_files, "COPY_CACHE_S", 0.0)
    assert (there.shown(row(1, "verified")) / "frames").read_bytes() == b"more"
    (work / "frames").write_bytes(b"changed")
    here.keep(FOLD, 1)
    assert (there.shown(row(1, "verified")) / "frames").read_bytes() == b"more"

    # Another machine goes on under a new epoch with what was kept under the last one.
    taken = there.bring(FOLD, 1, 2)
    assert (taken / "frames").read_bytes() == b"changed"
    there.keep(FOLD, 2)
    there.leave(FOLD, 2)
    assert not taken.exists()
    assert (here.shown(row(2, "verified")) / "frames").read_bytes() == b"changed"

    here.remove(FOLD)
    assert here.copied() == set()
    assert not (there.bring(FOLD, 2, 3) / "frames").exists()


def test_movie_is_fetched_and_removed(machines: tuple[Folders, Folders], tmp_path: Path) -> None:
    here, there = machines
    assert there.movie(FOLD, "m.mp4") is None
    (tmp_path / "made").write_bytes(b"movie")
    here.keep_movie(FOLD, "m.mp4", tmp_path / "made")
    brought = there.movie(FOLD, "m.mp4")
    assert brought is not None and brought.read_bytes() == b"movie"
    there.remove_movie(FOLD, "m.mp4")
    assert here.movie(FOLD, "m.mp4") is None
    assert not brought.exists()


def test_unseen_copies_make_room(
    machines: tuple[Folders, Folders], monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = machines
    copies: list[Path] = []
    for epoch in (1, 2, 3):
        work = here.bring(FOLD, epoch - 1, epoch)
        (work / "frames").write_bytes(bytes(400_000))
        here.keep(FOLD, epoch)
        copies.append(there.shown(row(epoch, "verified")))
        assert all(copy.is_dir() for copy in copies)  # each was looked at just now
    for copy, age in zip(copies, (3.0, 2.0, 1.0), strict=True):
        long_ago = copy.stat().st_mtime - age * MIN_COPY_AGE_S
        os.utime(copy, (long_ago, long_ago))
    monkeypatch.setattr(fold_files, "CACHE_SWEEP_S", 0.0)
    there.shown(row(3, "verified"))
    assert [copy.is_dir() for copy in copies] == [False, True, True]


def test_directories_of_removed_files_go_along(bucket_url: str, tmp_path: Path) -> None:
    """Attempts of a fold are found by their directories."""
    storage = open_storage(Settings(data_dir=tmp_path, storage_url=bucket_url))
    assert storage is not None
    storage.check()
    attempt = tmp_path / "made" / "attempts" / "0" / "two"
    attempt.parent.mkdir(parents=True)
    (tmp_path / "made" / "one").write_bytes(b"1")
    for there in (True, False):
        if there:
            attempt.write_bytes(b"2")
        else:
            attempt.unlink()
        storage.keep("folds/a/1", tmp_path / "made")
        assert storage.below("folds") == ["a"]
        assert storage.fetch("folds/a/1", tmp_path / "copy")
        assert (tmp_path / "copy" / "one").read_bytes() == b"1"
        assert (tmp_path / "copy" / "attempts").exists() == there
    assert not storage.fetch("folds/b/1", tmp_path / "other")


def test_storage_without_obstore_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "obstore.exceptions", None)
    with pytest.raises(StorageError, match=r"pip install 'foldback\[storage\]'"):
        open_storage(Settings(data_dir=tmp_path, storage_url="s3://bucket"))
