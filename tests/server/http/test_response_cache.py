"""Response cache: responses are reused for one second, and only marked ones."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import httpx
import pytest
from fastapi import FastAPI, Request
from fastapi.responses import Response

from server.http.response_cache import RESPONSE_CACHE_S, ResponseCache, mark
from tests.server.service import SNAKE, Service, owner


class Desk:
    """An application that counts what it is asked, with a clock of its own."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.now = 0.0
        self.status = "verified"
        app = FastAPI()

        @app.get("/folds/{fold_id}")
        def get(request: Request, fold_id: str) -> Response:  # pyright: ignore
            self.asked.append(fold_id)
            mark(request, SimpleNamespace(id=fold_id, status=self.status))
            return Response(f"{fold_id} {len(self.asked)}", headers={"ETag": '"1"'})

        @app.delete("/folds/{fold_id}")
        def delete(fold_id: str) -> None:  # pyright: ignore
            pass

        self._app = ResponseCache(app, clock=lambda: self.now)

    def get(self, path: str, **headers: str) -> httpx.Response:
        return asyncio.run(self._ask("GET", path, headers))

    def ask(self, method: str, path: str) -> httpx.Response:
        return asyncio.run(self._ask(method, path, {}))

    async def _ask(self, method: str, path: str, headers: dict[str, str]) -> httpx.Response:
        transport = httpx.ASGITransport(self._app)
        async with httpx.AsyncClient(transport=transport, base_url="http://here") as http:
            return await http.request(method, path, headers=headers)


@pytest.fixture
def desk() -> Desk:
    return Desk()


def test_response_is_reused_for_a_second(desk: Desk) -> None:
    first, second = desk.get("/folds/a"), desk.get("/folds/a")
    assert first.text == second.text == "a 1"
    assert first.headers == second.headers
    desk.now = RESPONSE_CACHE_S
    assert desk.get("/folds/a").text == "a 2"
    assert desk.get("/folds/a?from=1").text == "a 3"
    assert desk.get("/folds/a", Host="other").text == "a 4"
    assert desk.get("/folds/b").text == "b 5"


def test_known_etag_is_not_modified(desk: Desk) -> None:
    desk.get("/folds/a")
    known = desk.get("/folds/a", **{"If-None-Match": '"1"'})
    assert (known.status_code, known.content) == (304, b"")
    assert "content-length" not in known.headers
    assert len(desk.asked) == 1


@pytest.mark.parametrize("status", ["running", "failed", "cancelled", "deleted"])
def test_response_that_may_change_is_not_reused(desk: Desk, status: str) -> None:
    desk.get("/folds/a")
    desk.now, desk.status = RESPONSE_CACHE_S, status
    assert [desk.get("/folds/a").text for _ in range(2)] == ["a 2", "a 3"]


def test_deletion_ends_reuse_at_once(desk: Desk) -> None:
    for path in ("/folds/a", "/folds/b"):
        desk.get(path)
    desk.ask("DELETE", "/folds/a")
    assert (desk.get("/folds/a").text, desk.get("/folds/b").text) == ("a 3", "b 2")


def test_deleted_fold_is_gone_from_all_its_addresses(service: Service) -> None:
    fold = service.fold(SNAKE, seed="77")
    assert service.wait_over(fold["id"])["status"] == "verified"
    places = [f"/folds/{fold['id']}", f"/folds/{fold['id']}/batch?to=4", f"/api/folds/{fold['id']}"]
    for place in places:
        a, b = service.http.get(place), service.http.get(place)
        assert (a.status_code, a.content) == (b.status_code, b.content) == (200, a.content)
        assert a.headers["x-request-id"] != b.headers["x-request-id"]
        for name in ("content-security-policy", "cache-control", "content-type"):
            assert a.headers[name] == b.headers[name]
    service.http.delete(f"/api/folds/{fold['id']}", headers=owner(fold))
    assert [service.http.get(place).status_code for place in places] == [404, 404, 404]
