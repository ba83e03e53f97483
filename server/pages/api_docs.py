"""The API for people: its description on a page."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import Response

from server.pages.page import page

router = APIRouter(include_in_schema=False)


@router.get("/docs")
async def api_page() -> Response:
    """The API for people: its description, drawn by Swagger UI out of a package of its own."""
    return page("api.html")
