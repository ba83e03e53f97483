"""Addresses of a service below a path; tests/browser/test_base_path.py opens its pages."""

import httpx
import pytest
from fastapi import FastAPI
from fastapi.responses import PlainTextResponse, RedirectResponse

from foldback.server.http.base_path import BelowPath, at
from foldback.server.settings import Settings
from tests.case import case
from tests.server.asgi import send_request

HOST = "http://fold.example.org"


def answer_to(path: str, base_path: str = "/fold") -> httpx.Response:
    """Return the answer of an application of one page to a request."""
    app = FastAPI()
    app.add_api_route("/page", page)
    app.add_api_route("/to/{address:path}", to)
    app.add_middleware(BelowPath, base_path=base_path)
    return send_request(app, path, base_url=HOST)


async def page() -> PlainTextResponse:
    return PlainTextResponse(at("/page"))


async def to(address: str) -> RedirectResponse:
    return RedirectResponse(address)


def test_page_is_served_below_the_base_path_and_if_a_proxy_removed_it() -> None:
    for path in ("/fold/page", "/page"):
        assert answer_to(path).text == "/fold/page"
    assert answer_to("/page", base_path="").text == "/page"
    for path in ("/fold", "/foldpage", "/fold/fold/page"):
        assert answer_to(path).status_code == 404
    assert at("/page") == "/page"


def test_redirect_stays_below_the_base_path() -> None:
    for address, leads_to in (
        ("/fold/to//gallery", "/fold/gallery"),
        ("/fold/page/", f"{HOST}/fold/page"),
        ("/fold/to/https://example.org/x", "https://example.org/x"),
        ("/fold/to/benchmarks", "benchmarks"),
    ):
        assert answer_to(address).headers["location"] == leads_to


def test_base_path_of_other_forms_is_refused() -> None:
    for wrong in ("fold", "/fold/", "/", "/a b", "//x", "/<x>", '/"x'):
        with case(wrong), pytest.raises(ValueError, match="base_path"):
            Settings(base_path=wrong)
