"""What folds: the page of the success map."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import HTMLResponse, Response

from server.pages.page import page

router = APIRouter(include_in_schema=False)


@router.get("/what-folds", response_class=HTMLResponse)
async def what_folds() -> Response:
    """The success map, and what it says: ``make success-map`` draws it."""
    return page("what_folds.html", listed=True)
