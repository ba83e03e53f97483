"""Prerendered pages: the same for all visitors, rendered once and sent compressed."""

from __future__ import annotations

from functools import cache

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from foldback.server.context import context_of
from foldback.server.http.base_path import BASE_PATH
from foldback.server.http.downloads import Asset
from foldback.server.http.security import INDEXED_HEADERS
from foldback.server.pages.page import policy_of_pages, rendered, script_json

router = APIRouter(include_in_schema=False)


@router.get("/benchmarks", response_class=HTMLResponse)
async def benchmarks(request: Request) -> Response:
    """Return the page of benchmarks with the success map that ``make success-map`` draws."""
    return _answer(request, "benchmarks.html", listed=True)


@router.get("/docs", response_class=HTMLResponse)
async def api_page(request: Request) -> Response:
    """Return the page on which Swagger UI shows the API's description."""
    return _answer(request, "api.html")


@router.get("/my-folds", response_class=HTMLResponse)
async def my_folds(request: Request) -> Response:
    """Return the page *My folds*; its script requests the folds of the browser's owner token."""
    answer = _answer(request, "my_folds.html")
    # A browser that returns to the page must request it again, not restore its content.
    answer.headers["Cache-Control"] = "no-store"
    return answer


@router.get("/shapes/new", response_class=HTMLResponse)
async def editor(request: Request) -> Response:
    """Return the page of the editor."""
    facts = {"most_modules": context_of(request).settings.max_modules}
    return _answer(request, "editor.html", facts_json=script_json(facts))


def _answer(request: Request, template: str, *, listed: bool = False, **values: str) -> Response:
    headers = {"Content-Security-Policy": policy_of_pages()} | (INDEXED_HEADERS if listed else {})
    return _made(BASE_PATH.get(), template, **values).response(request, headers)


@cache
def _made(_base_path: str, template: str, **values: str) -> Asset:
    return Asset.of(rendered(template, **values).encode(), "text/html")
