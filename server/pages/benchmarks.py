"""Benchmarks: the page of the success map, which shows what folds and what does not."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from server.pages.page import page

router = APIRouter(include_in_schema=False)


@router.get("/benchmarks", response_class=HTMLResponse)
async def benchmarks() -> Response:
    """The success map, and what it says: ``make success-map`` draws it."""
    return page("benchmarks.html", listed=True)


@router.get("/what-folds")
async def earlier_address() -> Response:
    """Where the page was before."""
    return RedirectResponse("/benchmarks", status_code=301)
