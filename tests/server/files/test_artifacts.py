from __future__ import annotations

import asyncio
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from server.files.artifacts import FILES_AT_ONCE, MAX_PENDING_FILES, Artifacts
from server.store.fold_files import EXPORTS_DIR
from server.store.folds import Store
from server.store.tables import FoldRow
from tests.server.rows import SOMEBODY
from tests.server.store.test_rows import row


@pytest.fixture
def fold(store: Store) -> FoldRow:
    added = row(status="verified")
    store.add(added, SOMEBODY)
    store.directory(added.id).mkdir()
    (store.directory(added.id) / "plan").write_text("a plan")
    return added


def test_only_the_last_edition_of_a_file_is_stored(store: Store, fold: FoldRow) -> None:
    made: list[str] = []

    async def ask(edition: str) -> Path:
        def make() -> bytes:
            made.append(edition)
            return edition.encode()

        shop = Artifacts(store, on_stored=store.add_derived)
        return await shop.file(fold.id, "page.html", make, of="plan", edition=edition)

    before = store.fold(fold.id)
    paths = [asyncio.run(ask(edition)) for edition in ("a1", "a1", "b02", "b02")]
    assert made == ["a1", "b02"]
    assert paths[-1].read_text() == "b02"
    after = store.fold(fold.id)
    assert (after.bytes, after.derived_bytes) == (before.bytes, before.derived_bytes + 3)
    assert os.listdir(store.directory(fold.id) / EXPORTS_DIR) == [paths[-1].name]


def test_derived_files_do_not_count_as_the_fold(store: Store, fold: FoldRow) -> None:
    shop = Artifacts(store, on_stored=store.add_derived)
    asyncio.run(shop.file(fold.id, "picture.png", lambda: b"a picture", of="plan"))
    store.folders.keep_movie(fold.id, "movie.gif", store.directory(fold.id) / "plan")
    assert store.folders.keep(fold.id, 1) == len("a plan")


def test_files_may_be_stored_elsewhere(store: Store, fold: FoldRow, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()

    async def ask() -> Path:
        shop = Artifacts(store, folder=elsewhere)
        return await shop.file(fold.id, "x", lambda: b"x", of="plan")

    assert asyncio.run(ask()).parent == elsewhere
    assert os.listdir(store.directory(fold.id)) == ["plan"]


def test_making_leaves_the_threads_of_the_loop_free(store: Store) -> None:
    async def ask() -> None:
        shop, may_end = Artifacts(store), asyncio.Event()
        loop = asyncio.get_running_loop()
        loop.set_default_executor(ThreadPoolExecutor(1))

        def wait(number: int) -> int:
            asyncio.run_coroutine_threadsafe(may_end.wait(), loop).result(30.0)
            return number

        asked = [
            asyncio.create_task(shop.get_or_make(k, lambda k=k: wait(k)))
            for k in range(MAX_PENDING_FILES)
        ]
        await asyncio.sleep(0)
        assert await asyncio.wait_for(asyncio.to_thread(lambda: "quick"), 10.0) == "quick"
        may_end.set()
        assert await asyncio.gather(*asked) == list(range(MAX_PENDING_FILES))
        shop.close()

    asyncio.run(ask())


def test_failed_file_is_made_again(store: Store, fold: FoldRow) -> None:
    async def ask() -> None:
        shop = Artifacts(store)
        for _ in range(FILES_AT_ONCE + MAX_PENDING_FILES):
            with pytest.raises(ZeroDivisionError):
                await shop.get_or_make("key", lambda: 1 // 0)
        assert await shop.get_or_make("key", lambda: 1) == 1

    asyncio.run(ask())
