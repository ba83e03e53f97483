"""Previews in a storage: brought to who does not have them, and forgotten in time."""

from __future__ import annotations

from dataclasses import fields
from io import BytesIO
from pathlib import Path

import pytest

from server.files.previews import NoSuchPreviewError, Previews, ShapeOptions
from server.files.stored_previews import (
    UPLOAD,
    HeldPreview,
    StoredPreviews,
    superfluous,
    visitor_noted,
)
from server.files.uploads import Uploads
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

    def gone(coming: int, visitor: str) -> list[str]:
        found = superfluous(
            kept + flood, settings, now=150.0, coming=coming * 2**20, visitor=visitor
        )
        return sorted(found)

    assert gone(0, "") == ["old"]
    assert gone(2, "b") == ["b0", "old"]  # above what one visitor may hold
    assert gone(4, "d") == ["b0", "old"]  # above what all may, where one holds most
    assert gone(6, "b") == ["b0", "b1", "b2", "old"]


def test_other_options_have_a_report_of_their_own() -> None:
    others = [
        *(
            ShapeOptions(module="tetrahedron"),
            ShapeOptions(modules=64),
            ShapeOptions(method="exact"),
        ),
        *(ShapeOptions(repair=True), ShapeOptions(ends="surface"), ShapeOptions(as_voxels=True)),
        *(ShapeOptions(start=(0, 0, 0)), ShapeOptions(seed=1), ShapeOptions(path=False)),
        ShapeOptions(world="table"),
    ]
    assert len(others) == len(fields(ShapeOptions))
    assert len({options.key for options in (ShapeOptions(), *others)}) == len(others) + 1


@pytest.mark.parametrize("about", [b"[]", b"7", b"\xff", b"[" * 100_000])
def test_whose_preview_it_is_that_was_written_over_is_not_known(about: bytes) -> None:
    assert visitor_noted(about) == ""


@pytest.mark.parametrize("about", [b"[]", b"{}", b'{"filename": 7}', b"\xff"])
def test_there_is_no_preview_whose_note_was_written_over(about: bytes, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    previews, uploads = Previews(settings), Uploads(settings)
    with uploads.stored(BytesIO(b"[]"), "thing.stl") as upload:
        preview_id = previews.add(upload, "a")
    (previews.directory(preview_id) / UPLOAD).write_bytes(about)
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
