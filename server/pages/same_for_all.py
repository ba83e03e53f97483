"""Pages that are the same for everybody: each is made once, and sent packed."""

from __future__ import annotations

from functools import cache

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from server.api.context import context_of
from server.http.compression import Asset
from server.http.security import LISTED
from server.pages.page import policy_of_pages, rendered, script_json

router = APIRouter(include_in_schema=False)


@router.get("/benchmarks", response_class=HTMLResponse)
async def benchmarks(request: Request) -> Response:
    """The success map, which shows what folds and what does not: ``make success-map`` draws it."""
    return _answer(request, "benchmarks.html", listed=True)


@router.get("/what-folds")
async def earlier_address() -> Response:
    """Where the page of benchmarks was before."""
    return RedirectResponse("/benchmarks", status_code=301)


@router.get("/docs", response_class=HTMLResponse)
async def api_page(request: Request) -> Response:
    """The API for people: its description, drawn by Swagger UI out of a package of its own."""
    return _answer(request, "api.html")


@router.get("/my-folds", response_class=HTMLResponse)
async def my_folds(request: Request) -> Response:
    """What a browser has made: its script asks the API for it, with the browser's key."""
    answer = _answer(request, "my_folds.html")
    # A browser that comes back to it asks anew, and shows nothing of what was on it.
    answer.headers["Cache-Control"] = "no-store"
    return answer


@router.get("/shapes/new", response_class=HTMLResponse)
async def editor(request: Request) -> Response:
    """The editor: cells painted layer by layer, and the path through them."""
    facts = {"most_modules": context_of(request).settings.max_modules}
    return _answer(request, "editor.html", facts_json=script_json(facts))


def _answer(request: Request, template: str, *, listed: bool = False, **values: str) -> Response:
    headers = {"Content-Security-Policy": policy_of_pages()} | (LISTED if listed else {})
    return _made(template, **values).response(request, headers)


@cache
def _made(template: str, **values: str) -> Asset:
    return Asset.of(rendered(template, **values).encode(), "text/html")
