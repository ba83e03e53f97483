"""Pictures of folds that accompany links to them."""

import asyncio
import errno
import json
import os
from pathlib import Path
from types import SimpleNamespace

import httpx
import pytest
from fastapi import FastAPI

from foldback.planner.chain.chain_attributes import chain_attributes, chain_from_attributes
from foldback.server.errors import NoRoom
from foldback.server.files.artifacts import Artifacts
from foldback.server.files.pictures import MAX_CACHED_PICTURES, recent_pictures
from foldback.server.pages import pictures as pictures_module
from foldback.server.store.folds import Store
from tests.planner.chains import chain_of
from tests.server.rows import add_fold


class Pictures:
    """Routes of pictures of a store's folds; a short text replaces each drawing.

    Attributes:
        drawn: Names of the chains whose pictures were drawn.
        moments: Moments that were drawn.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self.recent = recent_pictures()
        self.drawn: list[str] = []
        self.moments: list[dict[str, object]] = []

    def draw(self, path: Path, moment: dict[str, object]) -> bytes:
        chain = chain_from_attributes(json.loads(path.read_bytes()))
        self.drawn.append(chain.name)
        self.moments.append(moment)
        return f"a picture of {chain.name}".encode()

    def add_fold(self, status: str) -> Path:
        """Return the directory of a new fold with the chain of a first candidate."""
        directory = self.store.directory(add_fold(self.store, name="snake", status=status).id)
        write_chain_file(directory, "first")
        return directory

    def request(self, directory: Path, times: int = 1, query: str = "") -> list[httpx.Response]:
        """Return the answers to ``times`` simultaneous requests."""

        async def ask() -> list[httpx.Response]:
            app = FastAPI()
            app.state.context = SimpleNamespace(
                store=self.store,
                artifacts=Artifacts(self.store),
                pictures=SimpleNamespace(recent=self.recent, drawn=self.draw),
                timelines=SimpleNamespace(get=lambda _: None),  # pyright: ignore
                settings=SimpleNamespace(read_only=False),
            )
            app.include_router(pictures_module.router)
            transport = httpx.ASGITransport(app)
            async with httpx.AsyncClient(transport=transport, base_url="http://here") as http:
                address = f"/folds/{directory.name}/picture.png{query}"
                return await asyncio.gather(*(http.get(address) for _ in range(times)))

        return asyncio.run(ask())


@pytest.fixture
def pictures(store: Store) -> Pictures:
    return Pictures(store)


def write_chain_file(directory: Path, name: str) -> None:
    chain = chain_of([(0, 0, 0), (1, 0, 0), (1, 1, 0)], name=name)
    (directory / "chain.json").write_text(json.dumps(chain_attributes(chain)))


def test_picture_is_drawn_once_for_many_requests(pictures: Pictures) -> None:
    directory = pictures.add_fold("verified")
    answers = pictures.request(directory, 20)
    assert {answer.content for answer in answers} == {b"a picture of first"}
    assert {answer.headers["Cache-Control"] for answer in answers} == {"private, no-cache"}
    pictures.request(directory)
    assert pictures.drawn == ["first"]


def test_picture_of_a_view_is_drawn_once_and_not_stored(pictures: Pictures) -> None:
    directory = pictures.add_fold("failed")
    query = "?view=12,-62,24,1.2"
    answers = pictures.request(directory, 20, query)
    answers += pictures.request(directory, 1, query)
    assert {answer.content for answer in answers} == {b"a picture of first"}
    assert pictures.drawn == ["first"]
    assert pictures.moments[0]["view"] == "12,-62,24,1.2"
    caption = {"name": "snake", "verdict": "Not verified", "tone": "bad"}
    assert pictures.moments[0]["caption"] == caption
    assert os.listdir(directory) == ["chain.json"]


def test_picture_of_a_nonsense_view_is_refused(pictures: Pictures) -> None:
    directory = pictures.add_fold("verified")
    for view in ("1", "1,2,3,x", "1,,,1,2", "9" * 70, "..%2F,,,1"):
        (answer,) = pictures.request(directory, query=f"?view={view}")
        assert answer.status_code == 422, view
    assert pictures.drawn == []


def test_recent_pictures_beyond_the_limit_are_dropped() -> None:
    recent = recent_pictures()
    for key in range(MAX_CACHED_PICTURES + 1):
        recent.keep(key, b"a picture")
        recent.get(0)
    assert recent.get(0) is not None
    assert recent.get(1) is None


def test_picture_of_an_earlier_chain_or_of_a_running_fold_is_drawn_again(
    pictures: Pictures,
) -> None:
    for status in ("verified", "running"):
        directory = pictures.add_fold(status)
        (first,) = pictures.request(directory)
        assert first.headers["Cache-Control"] == "private, no-cache"
        write_chain_file(directory, "second")
        later = max(path.stat().st_mtime for path in directory.iterdir()) + 1.0
        os.utime(directory / "chain.json", (later, later))
        (answer,) = pictures.request(directory)
        assert answer.content == b"a picture of second"


@pytest.mark.parametrize("query", ["", "?view=1,30,20,1"])
def test_picture_on_disk_that_became_read_only_is_refused_in_words(
    pictures: Pictures, monkeypatch: pytest.MonkeyPatch, query: str
) -> None:
    def fail_on_read_only_disk(*_: object) -> bytes:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(pictures_module, "moment_of", lambda *_: {})
    monkeypatch.setattr(pictures, "draw", fail_on_read_only_disk)
    with pytest.raises(NoRoom, match="read-only"):
        pictures.request(pictures.add_fold("failed"), query=query)
