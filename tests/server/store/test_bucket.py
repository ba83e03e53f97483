"""The object store of the tests itself: what the storage asks of one works with it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from server.settings import Settings
from server.store.object_store import StorageError, open_storage
from tests.server.bucket import Bucket


def test_each_test_has_a_bucket_of_its_own(
    bucket: Bucket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in bucket.environment.items():
        monkeypatch.setenv(name, value)
    here, there = (
        open_storage(Settings(data_dir=tmp_path, storage_url=bucket.bucket())) for _ in range(2)
    )
    assert here is not None and there is not None
    here.check()
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "one").write_bytes(b"1")
    assert here.keep("folds/a/1", tmp_path / "made") == 1
    assert here.below("folds") == ["a"]
    assert here.fetch("folds/a/1", tmp_path / "copy")
    assert (tmp_path / "copy" / "one").read_bytes() == b"1"
    # What is gone takes its directories along: a fold's attempts are looked for by theirs.
    (tmp_path / "made" / "attempts" / "0").mkdir(parents=True)
    (tmp_path / "made" / "attempts" / "0" / "two").write_bytes(b"2")
    here.keep("folds/a/1", tmp_path / "made")
    assert here.fetch("folds/a/1", tmp_path / "copy")
    assert (tmp_path / "copy" / "attempts" / "0" / "two").exists()
    (tmp_path / "made" / "attempts" / "0" / "two").unlink()
    here.keep("folds/a/1", tmp_path / "made")
    assert here.fetch("folds/a/1", tmp_path / "copy")
    assert not (tmp_path / "copy" / "attempts").exists()
    assert there.below("folds") == []
    assert not there.fetch("folds/a/1", tmp_path / "other")


def test_storage_without_obstore_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "obstore.exceptions", None)
    with pytest.raises(StorageError, match=r"pip install 'foldback\[storage\]'"):
        open_storage(Settings(data_dir=tmp_path, storage_url="s3://bucket"))
