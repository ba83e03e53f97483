"""Files of folds on two machines that share a storage: one stores them, the other shows them."""

import os
import shutil
import sys
from pathlib import Path

import pytest

from foldback.server.settings import Settings
from foldback.server.store import fold_files
from foldback.server.store.fold_files import MIN_COPY_AGE_S, Folders
from foldback.server.store.object_store import StorageError, open_storage
from foldback.server.store.tables import FoldRow

FOLD = "a1"


Machines = tuple[Folders, Folders]


@pytest.fixture
def machines(bucket_url: str, tmp_path: Path) -> Machines:
    """Directories of the machine that computes a fold, and of the one that shows it."""
    one, other = (
        Folders(Settings(data_dir=tmp_path / name, storage_url=bucket_url, cache_bytes=2**20))
        for name in ("here", "there")
    )
    (tmp_path / "aside").mkdir()
    (tmp_path / "aside" / "input").write_bytes(b"cells")
    one.adopt(tmp_path / "aside", FOLD)
    return one, other


def row(kept: int, status: str = "running") -> FoldRow:
    return FoldRow(id=FOLD, kept=kept, status=status)


def test_files_stored_under_an_epoch_are_shown_by_other_machines(
    machines: Machines, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other = machines
    work = one.bring(FOLD, 0, 1)
    assert (work / "input").read_bytes() == b"cells"
    (work / "frames").write_bytes(b"one")
    one.keep(FOLD, 1)
    copy = other.shown(row(1))
    assert (copy / "frames").read_bytes() == b"one"
    assert other.copied() == {FOLD}

    # A growing file is checked again after a moment, a finished one never.
    (work / "frames").write_bytes(b"more")
    one.keep(FOLD, 1)
    assert (other.shown(row(1)) / "frames").read_bytes() == b"one"
    monkeypatch.setattr(fold_files, "COPY_CACHE_S", 0.0)
    assert (other.shown(row(1, "verified")) / "frames").read_bytes() == b"more"
    (work / "frames").write_bytes(b"changed")
    one.keep(FOLD, 1)
    assert (other.shown(row(1, "verified")) / "frames").read_bytes() == b"more"

    # Another machine continues under a new epoch with the files of the last finished stage.
    (work / "frames").rename(work / "moved")
    one.keep(FOLD, 1, growing=True)
    taken = other.bring(FOLD, 1, 2)
    assert (taken / "frames").read_bytes() == b"changed"
    other.keep(FOLD, 2)
    other.leave(FOLD, 2)
    assert not taken.exists()
    for _ in range(2):  # a copy that was removed is fetched again
        copy = one.shown(row(2, "verified"))
        assert (copy / "frames").read_bytes() == b"changed"
        shutil.rmtree(copy)

    # A suspended execution that continues does not touch the files of a later one.
    later, _ = one.bring(FOLD, 2, 3), one.bring(FOLD, 1, 2)
    assert (later / "frames").read_bytes() == b"changed"

    one.remove(FOLD)
    assert not one.copied() and not (other.bring(FOLD, 2, 3) / "frames").exists()


def test_movie_is_fetched_and_removed(machines: Machines, tmp_path: Path) -> None:
    one, other = machines
    assert other.movie(FOLD, "m.mp4") is None
    (tmp_path / "made").write_bytes(b"movie")
    one.keep_movie(FOLD, "m.mp4", tmp_path / "made")
    brought = other.movie(FOLD, "m.mp4")
    assert brought is not None and brought.read_bytes() == b"movie"
    other.remove_movie(FOLD, "m.mp4")
    assert one.movie(FOLD, "m.mp4") is None
    assert not brought.exists()


def test_unseen_copies_make_room(machines: Machines, monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = machines
    copies: list[Path] = []
    for epoch in (1, 2, 3):
        (one.bring(FOLD, epoch - 1, epoch) / "frames").write_bytes(bytes(400_000))
        one.keep(FOLD, epoch)
        copies.append(other.shown(row(epoch, "verified")))
        assert all(copy.is_dir() for copy in copies)  # each was accessed just now
    for copy, age in zip(copies, (3.0, 2.0, 1.0), strict=True):
        long_ago = copy.stat().st_mtime - age * MIN_COPY_AGE_S
        os.utime(copy, (long_ago, long_ago))
    monkeypatch.setattr(fold_files, "CACHE_SWEEP_S", 0.0)
    other.shown(row(3, "verified"))
    assert [copy.is_dir() for copy in copies] == [False, True, True]


def test_files_are_deleted_with_their_directories_and_a_crash_leaves_no_part_of_them(
    machines: Machines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Attempts of a fold are found by their directories, which move when the fold ends."""
    key, here, there = "folds/b/1", tmp_path / "made", tmp_path / "copy"
    storage, other = (machine.storage for machine in machines)
    assert storage is not None and other is not None
    storage.check()
    assert not other.fetch(key, there)
    (here / "attempt").mkdir(parents=True)
    for name in ("head", "frames"):
        (here / "attempt" / name).write_bytes(b"1")
    storage.keep(key, here)
    (here / "attempt").rename(here / "result")
    delete = storage._delete

    def crash(name: str) -> None:
        if name.endswith("attempt/frames"):
            raise OSError("the machine has crashed")
        delete(name)

    monkeypatch.setattr(storage, "_delete", crash)
    with pytest.raises(StorageError):
        storage.keep(key, here)
    assert "attempt/frames" in other.names(key) and other.fetch(key, there)
    assert {path.name for path in there.iterdir()} == {".fetched.json", "result"}

    # If the machine goes on instead, files that are there again are stored again.
    monkeypatch.undo()
    (here / "result").rename(here / "attempt")
    storage.keep(key, here)
    assert sorted(other.names(key)) == ["attempt/frames", "attempt/head"]
    assert other.fetch(key, there) and (there / "attempt" / "head").read_bytes() == b"1"
    assert not (there / "result").exists()


def test_storage_without_obstore_reports_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "obstore.exceptions", None)
    with pytest.raises(StorageError, match=r"pip install 'foldback\[storage\]'"):
        open_storage(Settings(data_dir=tmp_path, storage_url="s3://bucket"))
