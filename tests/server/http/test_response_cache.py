"""Response cache: responses are reused for one second, and only marked ones."""

from types import SimpleNamespace

import httpx
import pytest
from fastapi import FastAPI, Request
from fastapi.responses import Response

from foldback.server.http.response_cache import RESPONSE_CACHE_S, ResponseCache, mark
from tests.server.asgi import send_request


class CountingApp:
    """Application that counts its requests, with a clock of its own."""

    def __init__(self) -> None:
        self.send_request: list[str] = []
        self.now = 0.0
        self.status = "verified"
        app = FastAPI()

        @app.get("/folds/{fold_id}")
        def get(request: Request, fold_id: str) -> Response:  # pyright: ignore
            self.send_request.append(fold_id)
            mark(request, SimpleNamespace(id=fold_id, status=self.status))
            return Response(f"{fold_id} {len(self.send_request)}", headers={"ETag": '"1"'})

        @app.delete("/folds/{fold_id}")
        def delete(fold_id: str) -> None:  # pyright: ignore
            pass

        self._app = ResponseCache(app, clock=lambda: self.now)

    def get(self, path: str, method: str = "GET", **headers: str) -> httpx.Response:
        return send_request(self._app, path, method=method, headers=headers)


@pytest.fixture
def counting_app() -> CountingApp:
    return CountingApp()


def test_response_is_reused_for_a_second(counting_app: CountingApp) -> None:
    first, second = counting_app.get("/folds/a"), counting_app.get("/folds/a")
    assert first.text == second.text == "a 1"
    assert first.headers == second.headers
    counting_app.now = RESPONSE_CACHE_S
    assert counting_app.get("/folds/a").text == "a 2"
    assert counting_app.get("/folds/a?from=1").text == "a 3"
    assert counting_app.get("/folds/a", Host="other").text == "a 4"
    assert counting_app.get("/folds/b").text == "b 5"


def test_known_etag_is_not_modified(counting_app: CountingApp) -> None:
    counting_app.get("/folds/a")
    known_counting_app = counting_app.get("/folds/a", **{"If-None-Match": '"1"'})
    assert (known_counting_app.status_code, known_counting_app.content) == (304, b"")
    assert "content-length" not in known_counting_app.headers
    assert len(counting_app.send_request) == 1


def test_response_that_may_change_is_not_reused(counting_app: CountingApp) -> None:
    for number, status in enumerate(("running", "failed", "cancelled", "deleted")):
        counting_app.status = status
        answers = [counting_app.get("/folds/a").text for _ in range(2)]
        assert answers == [f"a {2 * number + 1}", f"a {2 * number + 2}"], status


def test_deletion_ends_reuse_at_once(counting_app: CountingApp) -> None:
    for path in ("/folds/a", "/folds/b"):
        counting_app.get(path)
    counting_app.get("/folds/a", method="DELETE")
    assert (counting_app.get("/folds/a").text, counting_app.get("/folds/b").text) == ("a 3", "b 2")
