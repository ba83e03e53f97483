"""Previews in a storage: brought to who does not have them, and forgotten in time."""

from __future__ import annotations

import os
import threading
from dataclasses import fields
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from planner.pipeline.request import PreviewRequest
from server.errors import TooMany
from server.files import previews as previews_module
from server.files.previews import (
    MAX_OPTION_SETS,
    NoSuchPreviewError,
    Previews,
    _measure,
)
from server.files.stored_previews import (
    UPLOAD_FILE,
    HeldPreview,
    StoredPreviews,
    superfluous,
    visitor_noted,
)
from server.files.uploads import Uploads
from server.processes.children import Reader
from server.settings import Settings
from server.store.object_store import open_storage
from tests.server.bucket import Bucket


def held(name: str, touched: float, size: int, visitor: str) -> HeldPreview:
    return HeldPreview(name=name, touched=touched, size=size * 2**20, visitor=visitor)


def test_who_holds_most_loses_his_own_first(tmp_path: Path) -> None:
    settings = Settings(
        data_dir=tmp_path,
        previews_bytes=10 * 2**20,
        previews_of_visitor_bytes=6 * 2**20,
        preview_keep_s=100.0,
    )
    kept = [held("old", 1.0, 1, "c"), held("first", 110.0, 2, "a")]
    flood = [held(f"b{k}", 120.0 + k, 2, "b") for k in range(3)]

    def gone(*more: HeldPreview) -> list[str]:
        return sorted(superfluous([*kept, *flood, *more], settings, now=150.0))

    assert gone() == ["old"]
    assert gone(held("b3", 130.0, 2, "b")) == ["b0", "old"]  # above what one visitor may hold
    assert gone(held("d", 130.0, 4, "d")) == ["b0", "old"]  # above what all may hold


def test_superfluous_with_many_small_previews_removes_the_oldest_of_the_largest_number(
    tmp_path: Path,
) -> None:
    settings = Settings(data_dir=tmp_path, most_previews=5, most_previews_of_visitor=4)
    mine = [held("a", 1.0, 0, "a")]
    flood = [held(f"b{k}", 2.0 + k, 0, "b") for k in range(6)]
    others = [held(f"c{k}", 9.0 + k, 0, "c") for k in range(2)]
    assert superfluous([*mine, *flood, *others], settings, now=20.0) == ["b0", "b1", "b2", "b3"]


def test_previews_of_an_upload_by_strangers_leave_the_owner_its_own(tmp_path: Path) -> None:
    previews, uploads = Previews(Settings(data_dir=tmp_path)), Uploads(Settings(data_dir=tmp_path))
    reader = cast("Reader", SimpleNamespace(call=write_report))

    def ask(seed: int, visitor: str) -> None:
        previews.report(preview_id, PreviewRequest(seed=seed), reader, visitor=visitor)

    with uploads.stored(BytesIO(b"[]"), "thing.stl") as upload:
        preview_id = previews.add(upload, "owner")
    for seed in range(MAX_OPTION_SETS):
        ask(seed, "stranger")
    with pytest.raises(TooMany):
        ask(1000, "another")
    ask(1001, "owner")
    uploads.close()
    measured = _measure(tmp_path / "previews" / preview_id, None)
    assert measured[1].size < 64 * 1024 < MAX_OPTION_SETS * 4096 <= measured[1].foreign


def test_remove_of_preview_leaves_its_files_to_the_sweep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    previews, uploads = Previews(Settings(data_dir=tmp_path)), Uploads(Settings(data_dir=tmp_path))
    monkeypatch.setattr(previews, "_sweep_soon", lambda coming=0: None)
    with uploads.stored(BytesIO(b"[]"), "thing.stl") as upload:
        preview_id = previews.add(upload, "owner")
    previews.remove(preview_id)
    assert not previews.there(preview_id)
    assert len(list((tmp_path / "previews").iterdir())) == 1
    previews.sweep()
    assert list((tmp_path / "previews").iterdir()) == []
    uploads.close()


def write_report(kind: str, place: Path, **options: object) -> None:
    (place / "report.json").write_text("{}")


def test_sweep_of_previews_measures_only_what_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks of the disk count: a file of one byte takes 4 KiB."""
    previews, uploads = Previews(Settings(data_dir=tmp_path)), Uploads(Settings(data_dir=tmp_path))
    ids = []
    for visitor in "ab":
        with uploads.stored(BytesIO(b"0"), "thing.stl") as upload:
            ids.append(previews.add(upload, visitor))
    for thread in threading.enumerate():
        if thread.name == "preview-sweep":
            thread.join()
    measured: list[object] = []

    def measure(**values: Any) -> HeldPreview:
        measured.append(values)
        return HeldPreview(**values)

    monkeypatch.setattr(previews_module, "HeldPreview", measure)
    for preview_id in ids:  # used a while ago
        os.utime(tmp_path / "previews" / preview_id, (1e9, 1e9))
    settled = Previews(Settings(data_dir=tmp_path, preview_keep_s=1e10))
    settled.sweep()
    assert len(measured) >= 2
    assert all(cast("Any", each)["size"] >= 4096 for each in measured)
    measured.clear()
    settled.sweep()
    assert measured == []
    uploads.close()


def test_other_options_have_a_report_of_their_own() -> None:
    others = [
        *(
            PreviewRequest(module="tetrahedron"),
            PreviewRequest(modules=64),
            PreviewRequest(method="exact"),
        ),
        *(
            PreviewRequest(repair=True),
            PreviewRequest(ends="surface"),
            PreviewRequest(as_voxels=True),
        ),
        *(PreviewRequest(start=(0, 0, 0)), PreviewRequest(seed=1), PreviewRequest(path=False)),
        PreviewRequest(world="table"),
    ]
    assert len(others) == len(fields(PreviewRequest))
    assert len({options.key for options in (PreviewRequest(), *others)}) == len(others) + 1


@pytest.mark.parametrize("about", [b"[]", b"7", b"\xff", b"[" * 100_000])
def test_whose_preview_it_is_that_was_written_over_is_not_known(about: bytes) -> None:
    assert visitor_noted(about) == ""


@pytest.mark.parametrize("about", [b"[]", b"{}", b'{"filename": 7}', b"\xff"])
def test_there_is_no_preview_whose_note_was_written_over(about: bytes, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    previews, uploads = Previews(settings), Uploads(settings)
    with uploads.stored(BytesIO(b"[]"), "thing.stl") as upload:
        preview_id = previews.add(upload, "a")
    (previews.directory(preview_id) / UPLOAD_FILE).write_bytes(about)
    with pytest.raises(NoSuchPreviewError):
        previews.upload(preview_id)
    uploads.close()


def test_a_flood_of_previews_leaves_those_of_others(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, previews_bytes=8 * 2**20)
    previews, uploads = Previews(settings), Uploads(settings)

    def add(visitor: str) -> str:
        with uploads.stored(BytesIO(bytes(2**20)), "thing.stl") as upload:
            return previews.add(upload, visitor)

    mine = add("a")
    flood = [add("b") for _ in range(12)]
    previews.sweep()
    assert previews.filename(mine) == "thing.stl"
    with pytest.raises(NoSuchPreviewError):
        previews.filename(flood[0])
    uploads.close()


def test_kept_fetched_and_forgotten(
    bucket: Bucket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in bucket.environment.items():
        monkeypatch.setenv(name, value)
    url = bucket.bucket()

    def machine(name: str, **settings: object) -> StoredPreviews:
        chosen = Settings(data_dir=tmp_path / name, storage_url=url, **settings)  # type: ignore[arg-type]
        chosen.previews_dir.mkdir(parents=True, exist_ok=True)
        return StoredPreviews(chosen, open_storage(chosen))

    here, there = machine("here"), machine("there")
    mine, theirs = (tmp_path / name / "previews" for name in ("here", "there"))
    assert not there.fetch("p1", theirs / "p1")
    for name in ("p1", "p2"):
        (mine / name).mkdir()
        (mine / name / "input").write_bytes(bytes(600_000))
        (mine / name / UPLOAD_FILE).write_text("{}")
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
