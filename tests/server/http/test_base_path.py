"""Addresses of a service below a path; tests/browser/test_base_path.py opens its pages."""

from __future__ import annotations

import asyncio

import httpx
import pytest
from fastapi import FastAPI
from fastapi.responses import PlainTextResponse, RedirectResponse

from server.http.base_path import BelowPath, at
from server.settings import Settings

HOST = "http://fold.example.org"


def answered(path: str, base_path: str = "/fold") -> httpx.Response:
    """Return what an application of one page answers to a path."""
    app = FastAPI()

    @app.get("/page")
    async def page() -> PlainTextResponse:
        return PlainTextResponse(at("/page"))

    @app.get("/to/{address:path}")
    async def to(address: str) -> RedirectResponse:
        return RedirectResponse(address)

    app.add_middleware(BelowPath, base_path=base_path)

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url=HOST) as http:
            return await http.get(path)

    return asyncio.run(ask())


def test_page_is_found_below_the_base_path_and_where_a_proxy_took_it_off() -> None:
    for path in ("/fold/page", "/page"):
        assert answered(path).text == "/fold/page"
    assert answered("/page", base_path="").text == "/page"
    for path in ("/fold", "/foldpage", "/fold/fold/page"):
        assert answered(path).status_code == 404
    assert at("/page") == "/page"


@pytest.mark.parametrize(
    ("asked", "leads_to"),
    [
        ("/fold/to//gallery", "/fold/gallery"),
        ("/fold/page/", f"{HOST}/fold/page"),
        ("/fold/to/https://example.org/x", "https://example.org/x"),
        ("/fold/to/benchmarks", "benchmarks"),
    ],
)
def test_redirect_stays_below_the_base_path(asked: str, leads_to: str) -> None:
    assert answered(asked).headers["location"] == leads_to


@pytest.mark.parametrize("wrong", ["fold", "/fold/", "/", "/a b", "//x", "/<x>", '/"x'])
def test_base_path_of_other_forms_is_refused(wrong: str) -> None:
    with pytest.raises(ValueError, match="base_path"):
        Settings(base_path=wrong)
