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
from foldback.server.store.schema import FoldRow

FOLD = "a1"


Machines = tuple[Folders, Folders]


@pytest.fixture
def machines(bucket_url: str, tmp_path: Path) -> Machines:
    """Directories of the machine that computes a fold, and of the one that shows it."""
    first, second = (
        Folders(Settings(data_dir=tmp_path / name, storage_url=bucket_url, cache_bytes=2**20))
        for name in ("here", "there")
    )
    (tmp_path / "aside").mkdir()
    (tmp_path / "aside" / "input").write_bytes(b"cells")
    first.adopt(tmp_path / "aside", FOLD)
    return first, second


def row(stored_bytes: int, status: str = "running") -> FoldRow:
    return FoldRow(id=FOLD, kept=stored_bytes, status=status)


def test_files_stored_under_an_epoch_are_shown_by_other_machines(
    machines: Machines, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = machines
    monkeypatch.setattr(fold_files, "COPY_CACHE_S", 3600.0)
    work = first.bring(FOLD, 0, 1)
    assert (work / "input").read_bytes() == b"cells"
    (work / "frames").write_bytes(b"one")
    first.keep(FOLD, 1)
    copy = second.shown(row(1))
    assert (copy / "frames").read_bytes() == b"one"
    assert second.copied() == {FOLD}

    # A growing file is checked again after a moment, a finished one never.
    (work / "frames").write_bytes(b"more")
    first.keep(FOLD, 1)
    assert (second.shown(row(1)) / "frames").read_bytes() == b"one"
    monkeypatch.setattr(fold_files, "COPY_CACHE_S", 0.0)
    assert (second.shown(row(1, "verified")) / "frames").read_bytes() == b"more"
    (work / "frames").write_bytes(b"changed")
    first.keep(FOLD, 1)
    assert (second.shown(row(1, "verified")) / "frames").read_bytes() == b"more"

    # Another machine continues under a new epoch with the files of the last finished stage.
    (work / "frames").rename(work / "moved")
    first.keep(FOLD, 1, growing=True)
    path = second.bring(FOLD, 1, 2)
    assert (path / "frames").read_bytes() == b"changed"
    second.keep(FOLD, 2)
    second.leave(FOLD, 2)
    assert not path.exists()
    for _ in range(2):  # a copy that was removed is fetched again
        copy = first.shown(row(2, "verified"))
        assert (copy / "frames").read_bytes() == b"changed"
        shutil.rmtree(copy)

    # A suspended execution that continues does not touch the files of a later one.
    later, _ = first.bring(FOLD, 2, 3), first.bring(FOLD, 1, 2)
    assert (later / "frames").read_bytes() == b"changed"

    first.remove(FOLD)
    assert not first.copied() and not (second.bring(FOLD, 2, 3) / "frames").exists()


def test_movie_is_fetched_and_removed(machines: Machines, tmp_path: Path) -> None:
    first, second = machines
    assert second.movie(FOLD, "m.mp4") is None
    (tmp_path / "made").write_bytes(b"movie")
    first.keep_movie(FOLD, "m.mp4", tmp_path / "made")
    brought = second.movie(FOLD, "m.mp4")
    assert brought is not None and brought.read_bytes() == b"movie"
    second.remove_movie(FOLD, "m.mp4")
    assert first.movie(FOLD, "m.mp4") is None
    assert not brought.exists()


def test_unseen_copies_make_room(machines: Machines, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = machines
    copies: list[Path] = []
    for epoch in (1, 2, 3):
        (first.bring(FOLD, epoch - 1, epoch) / "frames").write_bytes(bytes(400_000))
        first.keep(FOLD, epoch)
        copies.append(second.shown(row(epoch, "verified")))
        assert all(copy.is_dir() for copy in copies)  # each was accessed just now
    for copy, age in zip(copies, (3.0, 2.0, 1.0), strict=True):
        long_ago = copy.stat().st_mtime - age * MIN_COPY_AGE_S
        os.utime(copy, (long_ago, long_ago))
    monkeypatch.setattr(fold_files, "CACHE_SWEEP_S", 0.0)
    second.shown(row(3, "verified"))
    assert [copy.is_dir() for copy in copies] == [False, True, True]


def test_files_are_deleted_with_their_directories_and_a_crash_leaves_no_part_of_them(
    machines: Machines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Attempts of a fold are found by their directories, which move when the fold ends."""
    key, source_directory, copy_directory = "folds/b/1", tmp_path / "made", tmp_path / "copy"
    storage, second = (machine.storage for machine in machines)
    assert storage is not None and second is not None
    storage.check()
    assert not second.fetch(key, copy_directory)
    (source_directory / "attempt").mkdir(parents=True)
    for name in ("head", "frames"):
        (source_directory / "attempt" / name).write_bytes(b"1")
    storage.keep(key, source_directory)
    (source_directory / "attempt").rename(source_directory / "result")
    delete = storage._delete

    def crash(name: str) -> None:
        if name.endswith("attempt/frames"):
            raise OSError("the machine has crashed")
        delete(name)

    monkeypatch.setattr(storage, "_delete", crash)
    with pytest.raises(StorageError):
        storage.keep(key, source_directory)
    assert "attempt/frames" in second.names(key) and second.fetch(key, copy_directory)
    assert {path.name for path in copy_directory.iterdir()} == {".fetched.json", "result"}

    # If the machine goes on instead, files that are there again are stored again.
    monkeypatch.undo()
    (source_directory / "result").rename(source_directory / "attempt")
    storage.keep(key, source_directory)
    assert sorted(second.names(key)) == ["attempt/frames", "attempt/head"]
    assert (
        second.fetch(key, copy_directory)
        and (copy_directory / "attempt" / "head").read_bytes() == b"1"
    )
    assert not (copy_directory / "result").exists()


def test_storage_without_obstore_reports_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "obstore.exceptions", None)
    with pytest.raises(StorageError, match=r"pip install 'foldback\[storage\]'"):
        open_storage(Settings(data_dir=tmp_path, storage_url="s3://bucket"))
