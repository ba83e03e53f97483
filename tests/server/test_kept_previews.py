"""Previews in a storage: brought to who does not have them, and forgotten in time."""

from __future__ import annotations

from pathlib import Path

import pytest

from server.kept_previews import UPLOAD, KeptPreviews
from server.settings import Settings
from server.storage import open_storage
from tests.server.bucket import Bucket


def test_kept_fetched_and_forgotten(
    bucket: Bucket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in bucket.environment.items():
        monkeypatch.setenv(name, value)
    url = bucket.bucket()

    def machine(name: str, **settings: object) -> KeptPreviews:
        chosen = Settings(data_dir=tmp_path / name, storage_url=url, **settings)  # type: ignore[arg-type]
        chosen.previews_dir.mkdir(parents=True, exist_ok=True)
        return KeptPreviews(chosen, open_storage(chosen))

    here, there = machine("here"), machine("there")
    mine, theirs = (tmp_path / name / "previews" for name in ("here", "there"))
    assert not there.fetch("p1", theirs / "p1")
    for name in ("p1", "p2"):
        (mine / name).mkdir()
        (mine / name / "input").write_bytes(bytes(600_000))
        (mine / name / UPLOAD).write_text("{}")
        here.keep(name, mine / name)
    assert there.fetch("p1", theirs / "p1")
    assert [path.name for path in theirs.iterdir()] == ["p1"]
    assert len((theirs / "p1" / "input").read_bytes()) == 600_000

    place = mine / "p1" / "key"
    place.mkdir()
    (place / "report.json").write_text('{"cells": []}')
    here.keep_report(place)
    there.fetch_report(theirs / "p1" / "key")
    assert (theirs / "p1" / "key" / "report.json").read_text() == '{"cells": []}'

    there.sweep()
    assert here.fetch("p2", tmp_path / "again")
    machine("small", previews_bytes=2**20).sweep()
    assert [here.fetch(name, tmp_path / f"then-{name}") for name in ("p1", "p2")].count(True) == 1
    machine("late", preview_keep_s=1e-6).sweep()
    assert not any(here.fetch(name, tmp_path / f"last-{name}") for name in ("p1", "p2"))
