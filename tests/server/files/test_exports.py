"""Files made from a finished fold: exports over HTTP and on the command line, and their storage."""

import asyncio
import os
import re
import shutil
import threading
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from foldback.planner.exports import leaflet
from foldback.planner.exports.formats import EXPORTS, export_named
from foldback.planner.storage.file_names import PLAN
from foldback.planner.storage.output_directory import FILE_LIST
from foldback.server.errors import NoRoom, NotFound, TooLarge, Unavailable
from foldback.server.files import exports as exports_module
from foldback.server.files.artifacts import FILES_AT_ONCE, MAX_PENDING_FILES, Artifacts
from foldback.server.files.exports import export_file
from foldback.server.pages.facts import fold_facts
from foldback.server.store.fold_files import EXPORTS_DIR
from foldback.server.store.fold_source import LocatedFold
from foldback.server.store.folds import NoSuchFoldError, Store
from foldback.server.store.schema import FoldRow
from foldback.words.fold import ShownFold
from tests.planner.chains import coil
from tests.planner.plans import resting, turn_by_turn
from tests.server.cli.test_command_line import foldback_json
from tests.server.rows import add_fold
from tests.server.service_process import SNAKE, FinishedFold, Service, path_file

OFFERED = [export for export in EXPORTS if not (export.resting or export.coded)]
"""Exports of a plan of cubes that does not rest between steps."""


def test_each_export_is_listed_and_downloaded(finished: FinishedFold) -> None:
    """The planner's tests check the content of the files."""
    listed = finished.http.get(finished.state["links"]["exports"]).json()["exports"]
    assert [listed_export["name"] for listed_export in listed] == [
        export.name for export in OFFERED
    ]
    facts = finished.http.get(f"{finished.page}/facts").json()
    assert facts["downloads"] == [
        {key: listed_export[key] for key in ("label", "hint", "href")} for listed_export in listed
    ]
    directory = finished.directory
    for export, first in zip(OFFERED, listed, strict=True):
        answer = finished.http.get(first["href"])
        assert answer.status_code == 200, answer.text
        assert answer.headers["content-type"] == export.media_type == first["media_type"]
        saved_as = export.filename if export.shared else f"path-{export.filename}"
        assert answer.headers["content-disposition"] == f'attachment; filename="{saved_as}"'
        export_path = directory / export.filename
        stored_path = (
            export_path if export_path.exists() else directory / EXPORTS_DIR / export_path.name
        )
        assert answer.content == stored_path.read_bytes() != b""
        assert not list((directory / EXPORTS_DIR).glob(".*"))
        assert finished.http.get(first["href"]).content == answer.content


def test_unknown_exports_are_refused(finished: FinishedFold) -> None:
    for name in ("dae", "plan.json", "URDF", "%2e%2e", ".%2fplan", "u" * 4000):
        answer = finished.http.get(f"{finished.api}/exports/{name}")
        assert (answer.status_code, len(answer.text) < 600) == (404, True)
        if name == "dae":
            assert answer.json()["code"] == "no-such-export"
            assert ", ".join(export.name for export in EXPORTS) in answer.json()["detail"]


@pytest.fixture
def fold(store: Store, finished: FinishedFold) -> FoldRow:
    """Row of a fold whose directory contains only a real plan, as those of old folds do."""
    added = add_fold(store, summary=finished.state["summary"])
    shutil.copy(finished.directory / "plan.npz", store.directory(added.id))
    return added


def export_fold(store: Store, fold: FoldRow, name: str, free: int = 0) -> Path:
    artifacts = Artifacts(store, min_free_disk_bytes=free)
    return asyncio.run(export_file(store, artifacts, fold.id, export_named(name)))


def test_model_of_the_fold_itself_is_exported(store: Store, fold: FoldRow) -> None:
    """A model without keyframes, as older folds have, is exported unchanged."""
    directory = store.directory(fold.id)
    assert export_fold(store, fold, "mjcf") == directory / EXPORTS_DIR / "model.xml"
    (directory / "model.xml").write_text("<mujoco/>")
    assert export_fold(store, fold, "mjcf") == directory / "model.xml"


def test_few_files_are_made_at_once_and_each_once(store: Store) -> None:
    may_end, built_exports = threading.Event(), list[object]()

    def slow(name: object) -> object:
        built_exports.append(name)
        assert may_end.wait(30.0)
        return name

    async def ask() -> None:
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(1))
        shop, names = Artifacts(store), list(range(MAX_PENDING_FILES))

        def made_by(name: object) -> Coroutine[Any, Any, object]:
            return shop.flight.get_or_make(name, lambda: slow(name))

        tasks = [asyncio.create_task(made_by(name)) for name in names * 3]
        while len(built_exports) < FILES_AT_ONCE:
            await asyncio.sleep(0.01)
        with pytest.raises(Unavailable) as refused:
            await made_by("one more")
        assert refused.value.code == "busy" and (refused.value.retry_after_s or 0) > 0
        assert len(built_exports) == FILES_AT_ONCE  # the others wait without occupying threads
        assert await asyncio.wait_for(asyncio.to_thread(lambda: "quick"), 10.0) == "quick"
        tasks[0].cancel()  # the other requests still need the file
        may_end.set()
        assert await asyncio.gather(*tasks[1:]) == [*names[1:], *names, *names]
        assert sorted(built_exports) == names  # type: ignore[type-var]
        assert await made_by("one more") == "one more"
        shop.close()

    asyncio.run(ask())


def test_export_older_than_its_plan_is_made_again_and_deleted_with_it(
    store: Store, fold: FoldRow
) -> None:
    path = export_fold(store, fold, "stl")
    right = path.read_bytes()
    path.write_bytes(b"kept")
    assert export_fold(store, fold, "stl").read_bytes() == b"kept"
    later = path.stat().st_mtime + 1.0
    os.utime(store.directory(fold.id) / "plan.npz", (later, later))
    with pytest.raises(NoRoom):
        export_fold(store, fold, "stl", free=2**62)
    assert export_fold(store, fold, "stl").read_bytes() == right
    store.delete(fold.id)
    with pytest.raises(NoSuchFoldError):
        export_fold(store, fold, "urdf")
    assert not store.directory(fold.id).exists()  # nothing remains of a deleted fold
    with pytest.raises(NotFound) as refusal:
        export_fold(store, fold, "urdf")
    assert refusal.value.code == "no-such-artifact"


def test_plans_too_large_for_the_service_are_refused_with_advice(
    store: Store, fold: FoldRow, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exports_module, "MAX_EXPORTED_PLAN_BYTES", 10_000)
    for name in ("csv", "mcap", "json", "leaflet"):
        with pytest.raises(TooLarge) as refused:
            export_fold(store, fold, name)
        assert "foldback export" in refused.value.detail
    assert export_fold(store, fold, "urdf").is_file()


def test_leaflets_of_too_many_steps_are_refused_with_advice(
    store: Store, fold: FoldRow, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(NotFound) as refused:
        export_fold(store, fold, "leaflet")
    assert "expected one made by the strategy turns" in refused.value.detail
    chain = coil(8)
    resting(chain, turn_by_turn(chain, 1)).save_npz(store.directory(fold.id) / PLAN)
    assert export_fold(store, fold, "leaflet-html").is_file()
    monkeypatch.setattr(leaflet, "MAX_DRAWN_MODULES", 8)
    for name in ("leaflet", "leaflet-letter"):
        with pytest.raises(TooLarge) as too_large:
            export_fold(store, fold, name)
        assert (too_large.value.code, "step document" in too_large.value.detail) == (
            "too-many-steps",
            True,
        )


HOSTILE_NAME = "</title><script>alert(1)</script>) >> /OpenAction << /S /JavaScript /JS (x) \\"
"""Name that would start scripts if a leaflet took it for HTML or PDF syntax."""


def test_leaflets_take_a_hostile_name_for_text(service: Service) -> None:
    data = path_file(SNAKE, name=HOSTILE_NAME)
    accepted = service.upload("snake.json", data, strategy="turns").json()
    assert service.wait_over(accepted["id"])["status"] == "verified"
    api = f"/api/folds/{accepted['id']}"
    listed = {
        export["name"]: export for export in service.http.get(f"{api}/exports").json()["exports"]
    }
    for name in ("leaflet", "leaflet-letter", "leaflet-html"):
        answer = service.http.get(listed[name]["href"])
        assert answer.status_code == 200, answer.text
        assert answer.headers["content-type"] == listed[name]["media_type"]
        assert re.fullmatch(
            r'attachment; filename="[\w.-]+"', answer.headers["content-disposition"]
        )
        assert answer.headers["content-security-policy"].startswith("sandbox; default-src 'none'")
        odd = {"size": "9" * 400, "name": "../../folds", "steps": "1e999"}
        assert service.http.get(listed[name]["href"], params=odd).content == answer.content
        if name == "leaflet-html":
            assert "<script" not in answer.text and "&lt;script&gt;" in answer.text
            continue
        syntax = re.sub(rb"stream\r?\n.*?endstream", b"", answer.content, flags=re.DOTALL)
        syntax = re.sub(rb"\((?:\\.|[^\\()])*\)", b"", syntax, flags=re.DOTALL)
        assert b"/Title" in syntax
        assert not re.search(rb"/(JS|JavaScript|OpenAction|AA|URI|Launch)\b", syntax)


def test_downloads_of_a_plan_without_frames_leave_out_motion(store: Store, fold: FoldRow) -> None:
    fold.summary = {**fold.summary, "playback": None}
    found_fold = LocatedFold(ShownFold.of(fold), store.directory(fold.id))
    offered = [
        download["href"].rpartition("/")[2] for download in fold_facts(found_fold)["downloads"]
    ]
    assert offered == [export.name for export in OFFERED if not export.moving]
    assert fold_facts(found_fold, api=False)["downloads"] == []


def test_export_command_writes_the_requested_files(finished: FinishedFold, tmp_path: Path) -> None:
    directory, out = finished.directory, tmp_path / "a" / "b"
    sizes = foldback_json("export", directory, "--as", "urdf, stl", "--out", out)["bytes"]
    assert sizes == {name: (out / name).stat().st_size for name in ("model.urdf", "module.stl")}
    assert {path.name for path in out.iterdir()} == {*sizes, FILE_LIST}
    foldback_json("export", directory, "--out", tmp_path / "all")
    files = {path.name for path in (tmp_path / "all").iterdir()}
    assert files == {FILE_LIST, *(export.filename for export in OFFERED)}


@pytest.fixture
def small_fold(store: Store) -> FoldRow:
    added = add_fold(store)
    (store.directory(added.id) / "plan").write_text("a plan")
    return added


def test_only_the_last_edition_of_a_file_is_stored(store: Store, small_fold: FoldRow) -> None:
    built_names: list[str] = []

    async def ask(edition: str) -> Path:
        def make() -> bytes:
            built_names.append(edition)
            return edition.encode()

        shop = Artifacts(store)
        return await shop.file(
            small_fold.id,
            store.directory(small_fold.id),
            "page.html",
            make,
            of="plan",
            edition=edition,
        )

    before = store.fold(small_fold.id)
    paths = [asyncio.run(ask(edition)) for edition in ("a1", "a1", "b02", "b02")]
    assert built_names == ["a1", "b02"]
    assert paths[-1].read_text() == "b02"
    after = store.fold(small_fold.id)
    assert (after.bytes, after.derived_bytes) == (before.bytes, before.derived_bytes + 3)
    assert os.listdir(store.directory(small_fold.id) / EXPORTS_DIR) == [paths[-1].name]


def test_derived_files_do_not_count_as_the_fold_and_may_be_stored_elsewhere(
    store: Store, small_fold: FoldRow, tmp_path: Path
) -> None:
    def made(name: str, **place_options: Any) -> Path:
        shop = Artifacts(store, **place_options)
        return asyncio.run(
            shop.file(
                small_fold.id, store.directory(small_fold.id), name, lambda: b"made", of="plan"
            )
        )

    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    assert made("picture.png", folder=elsewhere).parent == elsewhere
    assert os.listdir(store.directory(small_fold.id)) == ["plan"]
    made("picture.png")
    store.folders.keep_movie(small_fold.id, "movie.gif", store.directory(small_fold.id) / "plan")
    assert store.folders.keep(small_fold.id, 1) == len("a plan")


def test_failed_file_is_made_again(store: Store, small_fold: FoldRow) -> None:
    async def ask() -> None:
        shop = Artifacts(store)
        for _ in range(FILES_AT_ONCE + MAX_PENDING_FILES):
            with pytest.raises(ZeroDivisionError):
                await shop.flight.get_or_make("key", lambda: 1 // 0)
        assert await shop.flight.get_or_make("key", lambda: 1) == 1

    asyncio.run(ask())


def test_export_is_flushed_to_disk_before_it_counts(
    store: Store, small_fold: FoldRow, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut leaves empty those files that were renamed and not flushed."""
    directory = store.directory(small_fold.id)
    flushed: list[int] = []
    flush = os.fsync

    def fsync(handle: int) -> None:
        flushed.append(os.fstat(handle).st_ino)
        flush(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    path = asyncio.run(
        Artifacts(store).file(small_fold.id, directory, "plan.json", lambda: b"{}", of="plan")
    )
    assert path.read_bytes() == b"{}"
    assert path.stat().st_ino in flushed
