"""Previews: the page that shows a shape before it is folded, and its 3D view."""

from __future__ import annotations

import asyncio
from functools import cache, lru_cache
from pathlib import Path
from typing import Final

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from planner.pathfinding.path_options import MAX_TABLE_MODULES
from server.api.context import context_of
from server.files.preview_reports import OPTIONS_KEY, cells_of_repair, read_report
from server.http.client_address import address_of
from server.http.downloads import BINARY_MEDIA_TYPE
from server.pages.page import drawing, page, script_addresses, script_json
from server.pages.problem_page import not_found_page
from server.store.previews import NoSuchPreviewError, Previews
from web.pictures.preview_drawing import preview_svg
from words.fold import shown_name
from words.missing_pages import NO_PREVIEW

router = APIRouter(include_in_schema=False)

SCENE_CACHE_CONTROL: Final = "private, max-age=3600"


@router.get("/previews/{preview_id}", response_class=HTMLResponse)
async def preview_page(request: Request, preview_id: str) -> Response:
    """Return the page of a preview."""
    context = context_of(request)
    try:
        filename = (await asyncio.to_thread(context.previews.row, preview_id)).filename
    except NoSuchPreviewError:
        return not_found_page(*NO_PREVIEW)
    name = shown_name((filename or "shape").rpartition(".")[0] or filename or "shape")
    facts: dict[str, object] = {
        "id": preview_id,
        "name": name,
        "most_modules": context.settings.max_modules,
        "table_modules": MAX_TABLE_MODULES,
        "next_scripts": _next_scripts(),
    }
    preparing = await asyncio.to_thread(context.leases.preparing)
    return page("preview.html", facts=facts, facts_json=script_json(facts), preparing=preparing)


@cache
def _next_scripts() -> list[str]:
    """Return the addresses of the scripts of a fold's page that a preview's page has not loaded."""
    loaded = script_addresses("preview")
    return [address for address in script_addresses("fold") if address not in loaded]


@router.get("/previews/{preview_id}/drawing.svg")
async def drawing_of_preview(
    request: Request, preview_id: str, key: str = "", repair: bool = False
) -> Response:
    """Return the drawing of a preview for the options of ``key``, without any text from users."""
    previews = context_of(request).previews
    svg = await asyncio.to_thread(_drawing, previews, preview_id, key, repair=repair)
    return drawing(svg or "", SCENE_CACHE_CONTROL)


@router.get("/previews/{preview_id}/scene/{key}")
async def scene_of_preview(
    request: Request, preview_id: str, key: str, repair: bool = False
) -> Response:
    """Return the 3D scene for viser's client (see ``web.viser.preview_scene``)."""
    data = await context_of(request).preview_scenes.scene(
        preview_id, key, visitor=address_of(request), repair=repair
    )
    return Response(
        data, media_type=BINARY_MEDIA_TYPE, headers={"Cache-Control": SCENE_CACHE_CONTROL}
    )


def _drawing(previews: Previews, preview_id: str, key: str, *, repair: bool) -> str | None:
    if not OPTIONS_KEY.fullmatch(key):
        return None
    try:
        return _drawing_at(previews.place(preview_id, key), repair=repair)
    except (NoSuchPreviewError, LookupError, ValueError):
        return None


@lru_cache(maxsize=32)
def _drawing_at(place: Path, *, repair: bool) -> str | None:
    report = read_report(place)
    if report is None:
        raise LookupError(place)  # so that it is looked for again
    return preview_svg(report, cells_of_repair(place) if repair else ())
