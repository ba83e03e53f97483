"""My folds: what this browser has made. Its script asks the API for it, with the browser's key."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import HTMLResponse, Response

from server.pages.page import page

router = APIRouter(include_in_schema=False)


@router.get("/my-folds", response_class=HTMLResponse)
async def my_folds_page() -> Response:
    """The same page for everybody: the service does not know whose it is."""
    return page("my_folds.html")
