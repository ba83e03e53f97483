"""Previews: their limits, sweeps and copies in an object store, on both databases."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from dataclasses import fields
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import sqlalchemy as sa

from foldback.planner.pipeline.request import PreviewRequest
from foldback.planner.storage.files import write_sealed_json
from foldback.server.errors import TooMany, Unusable
from foldback.server.files import preview_reports
from foldback.server.files.preview_reports import Asker, PreviewReports, read_report
from foldback.server.files.uploads import Uploads
from foldback.server.processes.children import ChildError, Pool
from foldback.server.settings import Settings
from foldback.server.store import previews as previews_module
from foldback.server.store.folds import Store
from foldback.server.store.previews import (
    MAX_PROTECTED_UPLOADS,
    MIN_LOST_AGE_S,
    NoSuchPreviewError,
    Previews,
    PreviewSize,
    superfluous,
)
from foldback.server.store.schema import PreviewRow
from tests.case import case
from tests.server.rows import new_owner
from tests.server.service_thread import copy_schema

MIB = 2**20


class Site:
    """Previews of one web process, with empty reports."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.store = Store(settings)
        self.previews = Previews(settings, self.store)
        self.uploads = Uploads(settings)
        reader = cast("Pool", SimpleNamespace(call=self._compute))
        self.reports = PreviewReports(settings, self.previews, reader)

    def close(self) -> None:
        self.uploads.close()
        self.store.close()

    def add(self, visitor: str = "owner", *, size: int = 2, **extra: Any) -> str:
        with self.uploads.stored(BytesIO(bytes(size)), "thing.stl") as upload:
            return self.reports.add(upload, visitor, **extra)

    def report(self, preview_id: str, seed: int = 0, visitor: str = "owner") -> None:
        self.reports.report(preview_id, PreviewRequest(seed=seed), Asker(visitor=visitor))

    def age(self, preview_id: str, seconds: float) -> None:
        """Move the times of a preview and of its upload into the past."""
        then = time.time() - seconds
        older = sa.update(PreviewRow).where(PreviewRow.id == preview_id)
        with self.store.changing() as session:
            session.execute(older.values(created_at=then, seen_at=then))

    @property
    def names(self) -> set[str]:
        return {path.name for path in self.settings.previews_dir.iterdir()}

    def exists(self, preview_id: str) -> bool:
        with suppress(NoSuchPreviewError):
            return self.previews.directory(preview_id).is_dir()
        return False

    @staticmethod
    def _compute(_task: str, place: Path, **_: object) -> None:
        if '"seed": 666' in (place / "request.json").read_text():
            raise ChildError("crashed", "It crashed.")
        write_sealed_json(place / "report.json", {"cells": [], "module_value": "cube"})


SiteWith = Callable[..., Site]


@pytest.fixture
def site_with(tmp_path: Path) -> Iterator[SiteWith]:
    """Function that creates the previews of a web process with some settings."""
    with ExitStack() as sites:

        def make(**settings: Any) -> Site:
            chosen_settings = Settings(**{"data_dir": tmp_path / "here", **settings})
            copy_schema(chosen_settings)
            return sites.enter_context(closing(Site(chosen_settings)))

        yield make


def size(name: str, seen_at: float, mib: int, visitor: str) -> PreviewSize:
    return PreviewSize(id=name, seen_at=seen_at, own_bytes=mib * MIB, visitor=visitor)


def deleted(settings: Settings, sizes: list[PreviewSize], now: float) -> list[str]:
    return sorted(preview.id for preview in superfluous(sizes, settings, now=now))


def test_superfluous_with_large_previews_returns_the_oldest_of_the_largest_visitor(
    tmp_path: Path,
) -> None:
    settings = Settings(
        data_dir=tmp_path,
        previews_bytes=10 * MIB,
        previews_of_visitor_bytes=6 * MIB,
        preview_keep_s=100.0,
    )
    stored = [size("old", 1.0, 1, "c"), size("first", 110.0, 2, "a")]
    stored += [size(f"b{k}", 120.0 + k, 2, "b") for k in range(3)]
    assert deleted(settings, stored, 150.0) == ["old"]
    above_own_limit = [*stored, size("b3", 130.0, 2, "b")]
    assert deleted(settings, above_own_limit, 150.0) == ["b0", "old"]
    above_total = [*stored, size("d", 130.0, 4, "d")]
    assert deleted(settings, above_total, 150.0) == ["b0", "old"]


def test_superfluous_with_many_small_previews_returns_the_oldest_of_the_largest_number(
    tmp_path: Path,
) -> None:
    settings = Settings(data_dir=tmp_path, most_previews=5, most_previews_of_visitor=4)
    stored = [size("a", 1.0, 0, "a"), *(size(f"c{k}", 9.0 + k, 0, "c") for k in range(2))]
    stored += [size(f"b{k}", 2.0 + k, 0, "b") for k in range(6)]
    assert deleted(settings, stored, 20.0) == ["b0", "b1", "b2", "b3"]


def test_reports_of_strangers_leave_the_uploader_its_own(
    site_with: SiteWith, each_settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    maximum = 20
    monkeypatch.setattr(preview_reports, "MAX_OPTION_SETS", maximum)
    site = site_with(database_url=each_settings.database_url)
    preview_id = site.add()
    for seed in range(maximum):
        site.report(preview_id, seed, "stranger")
    with pytest.raises(TooMany):
        site.report(preview_id, 1000, "another")
    site.report(preview_id, 1001)
    (stored,) = site.previews._sizes()
    assert stored.own_bytes < 64 * 1024 < maximum * 4096 <= stored.foreign


def test_reports_that_fail_count_once(site_with: SiteWith) -> None:
    site = site_with()
    preview_id = site.add()
    for _ in range(2):
        with pytest.raises(Unusable):
            site.report(preview_id, 666)
    assert site.previews.reports(preview_id, foreign=False) == 1


def test_remove_leaves_the_files_to_the_sweep(site_with: SiteWith) -> None:
    site, owner = site_with(), new_owner()
    preview_id = site.add(owner=owner)
    assert not site.previews.remove(preview_id, new_owner())
    assert site.previews.remove(preview_id, owner)
    assert not site.exists(preview_id)
    assert site.names == {preview_id}
    site.previews.sweep()
    assert not site.names


def test_sweep_deletes_expired_previews_and_measures_no_files(
    site_with: SiteWith, each_settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = site_with(database_url=each_settings.database_url, preview_keep_s=1000.0)
    old, new = site.add(), site.add()
    monkeypatch.setattr(previews_module, "blocks_of", None)
    assert all(stored.own_bytes >= 4096 for stored in site.previews._sizes())  # a file of two bytes
    site.age(old, 1001.0)
    site.previews.sweep()
    assert site.names == {new}


def test_sweep_deletes_files_without_a_row_and_rows_without_files(site_with: SiteWith) -> None:
    site = site_with()
    for name in ("of-an-earlier-version", ".being-fetched"):
        (site.settings.previews_dir / name).mkdir()
    kept_preview, lost, new = site.add(), site.add(), site.add()
    for preview_id in (lost, new):
        (site.previews.directory(preview_id) / "input").parent.rename(
            site.settings.root / preview_id
        )
    site.age(lost, MIN_LOST_AGE_S + 1)
    site.previews.sweep()
    assert site.names == {kept_preview, ".being-fetched"}
    assert site.previews._ids() == {kept_preview, new}


def test_sweep_leaves_the_newest_uploads_until_they_are_read(site_with: SiteWith) -> None:
    site = site_with(most_previews=1)
    uploads = [site.add() for _ in range(MAX_PROTECTED_UPLOADS + 1)]
    site.previews.sweep()
    assert site.names == set(uploads[1:])
    for preview_id in uploads[1:]:
        site.report(preview_id)
    site.previews.sweep()
    assert len(site.names) == 1


def test_flood_of_previews_leaves_those_of_others(site_with: SiteWith) -> None:
    site = site_with(previews_bytes=8 * MIB)
    own_preview = site.add("a", size=MIB)
    flood = [site.add("b", size=MIB) for _ in range(12)]
    site.previews.sweep()
    assert site.exists(own_preview) and not site.exists(flood[0])


def test_key_differs_for_each_option() -> None:
    changes: dict[str, Any] = {"modules": 64, "method": "exact", "ends": "surface", "seed": 1}
    changes |= {"repair": True, "as_voxels": True, "path": False, "start": (0, 0, 0)}
    changes |= {"module": "tetrahedron", "world": "table", "quick": True}
    changes |= {"threshold": 0.5, "inside_out": True, "thickness": 2}
    other_preview_requests = [PreviewRequest(**{name: value}) for name, value in changes.items()]
    assert len(other_preview_requests) == len(fields(PreviewRequest))
    assert (
        len({options.key for options in (PreviewRequest(), *other_preview_requests)})
        == len(other_preview_requests) + 1
    )


def test_row_of_unknown_id_raises(tmp_path: Path) -> None:
    with closing(Site(Settings(data_dir=tmp_path))) as site:
        for preview_id in ("", "..", "a/b", "a\x00", "é", "a" * 33, "nosuchpreview"):
            with case(preview_id), pytest.raises(NoSuchPreviewError):
                site.previews.row(preview_id)


@pytest.mark.processes
def test_previews_in_an_object_store_are_fetched_and_deleted_everywhere(
    bucket_url: str, tmp_path: Path
) -> None:
    shared = {"storage_url": bucket_url, "database_url": f"sqlite:///{tmp_path / 'rows.db'}"}
    first, second = (Site(Settings(data_dir=tmp_path / name, **shared)) for name in ("a", "b"))
    with closing(first), closing(second):
        small, large, small_owner = first.add(), first.add(size=600_000), new_owner()
        first.report(large)
        assert (second.previews.directory(large) / "input").stat().st_size == 600_000
        key = PreviewRequest(seed=3).key
        first.report(large, 3)
        assert read_report(second.previews.place(large, key)) == {
            "cells": [],
            "module_value": "cube",
        }
        own_preview = second.add(owner=small_owner)
        assert first.exists(own_preview)
        storage = first.store.folders.storage
        assert storage is not None
        (tmp_path / "stray").mkdir()
        (tmp_path / "stray" / "input").write_bytes(b"")
        storage.keep("previews/stray", tmp_path / "stray")
        second.previews.remove(own_preview, small_owner)
        second.previews.sweep()  # objects without a row
        assert set(storage.below("previews")) == {small, large}
        first.age(large, 2 * first.settings.preview_keep_s)
        first.previews.sweep()
        second.previews.sweep()
        assert set(storage.below("previews")) == first.names == {small}
        assert large not in second.names and not second.exists(large)


def test_damaged_report_is_computed_again(site_with: Callable[..., Site]) -> None:
    site = site_with()
    preview_id = site.add()
    site.report(preview_id)
    place = site.previews.place(preview_id, PreviewRequest().key)
    file = place / "report.json"
    file_bytes = file.read_bytes()
    for damaged in (
        b"{}",
        b'{"has_path": 1}',
        file_bytes[:-1],
        file_bytes.replace(b"cells", b"cellt"),
        b"",
    ):
        file.write_bytes(damaged)
        assert read_report(place) is None
        site.report(preview_id)
        assert file.read_bytes() == file_bytes
