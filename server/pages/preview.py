"""Previews: the page that shows a shape before it is folded, and its 3D view."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from functools import cache
from typing import Any, Final

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.pathfinding.path_options import MAX_TABLE_MODULES, MODULE_CHOICES
from foldback.server.api.shapes import texts_of
from foldback.server.context import Context, context_of
from foldback.server.errors import NotFound
from foldback.server.files.preview_reports import OPTIONS_KEY, cells_of_repair, read_report
from foldback.server.http.client_address import address_of
from foldback.server.http.downloads import BINARY_MEDIA_TYPE
from foldback.server.pages.page import drawing, not_found, page, script_addresses, script_json
from foldback.server.pages.problem_page import not_found_page
from foldback.server.store.fold_files import NoSuchFoldError
from foldback.server.store.previews import NoSuchPreviewError, Previews
from foldback.server.submission.fold_inputs import stored_options
from foldback.web.pictures.preview_drawing import preview_svg
from foldback.web.viser.preview_scene import preview_scene_of
from foldback.words.fold import ShownFold, shown_name
from foldback.words.missing_pages import NO_FOLD, NO_INPUT, NO_PREVIEW, NO_SHAPE

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
    return _page(context, {"id": preview_id, "name": name})


@router.get("/folds/{fold_id}/options", response_class=HTMLResponse)
async def options_page(request: Request, fold_id: str) -> Response:
    """Return a preview's page for the input and the options of a fold.

    Its script creates the preview, so that opening the address stores nothing.
    """
    context = context_of(request)

    def facts() -> dict[str, object]:
        row, directory = context.store.fold(fold_id), context.store.directory(fold_id)
        options = texts_of(stored_options(directory).changed())
        origin = {"fold": fold_id}
        return {"id": "", "origin": origin, "options": options, "name": ShownFold.of(row).title}

    try:
        return _page(context, await asyncio.to_thread(facts))
    except NoSuchFoldError:
        return not_found_page(*NO_FOLD)
    except NotFound:
        return not_found_page(*NO_INPUT)


@router.get("/gallery/{name}", response_class=HTMLResponse)
async def shape_page(request: Request, name: str) -> Response:
    """Return a preview's page for an example shape; its script creates the preview."""
    context = context_of(request)
    shape = context.gallery.shape(name)
    if shape is None:
        return not_found_page(*NO_SHAPE)
    options = (
        {"world": "table", "as_voxels": "true"}
        if request.query_params.get("world") == "table"
        else {}
    )
    facts = {"id": "", "origin": {"shape": name}, "options": options, "name": shape.title}
    return _page(context, facts)


def _page(context: Context, query: Mapping[str, object]) -> Response:
    """Return the page of a preview, or of an input that has no preview yet."""
    facts: dict[str, object] = {
        "origin": {},
        "options": {},
        "most_modules": context.settings.max_modules,
        "table_modules": MAX_TABLE_MODULES,
        "path_modules": [name for name in MODULE_CHOICES if module_named(name).follows_paths],
        "next_scripts": _next_scripts(),
        **query,
    }
    return page("preview.html", facts=facts, facts_json=script_json(facts))


@cache
def _next_scripts() -> list[str]:
    """Return the addresses of the scripts of a fold's page that a preview's page has not loaded."""
    loaded = script_addresses("preview")
    return [address for address in script_addresses("fold") if address not in loaded]


@router.get("/previews/{preview_id}/drawing.svg")
async def drawing_of_preview(
    request: Request, preview_id: str, key: str = "", repair: bool = False
) -> Response:
    """Return a preview's drawing for the options that ``key`` names; it has no text by users."""
    previews = context_of(request).previews

    def drawn() -> str:
        report = _report(previews, preview_id, key, repair=repair)
        return preview_svg(report, report["added"] if repair else ()) or ""

    try:
        return drawing(await asyncio.to_thread(drawn), SCENE_CACHE_CONTROL)
    except NoSuchPreviewError:
        return not_found()


@router.get("/previews/{preview_id}/scene/{key}")
async def scene_of_preview(
    request: Request, preview_id: str, key: str, repair: bool = False
) -> Response:
    """Return the 3D scene for viser's client (see ``web.viser.preview_scene``)."""
    context = context_of(request)
    data = await context.answers.get_or_make(
        ("scene", preview_id, key, repair),
        lambda: preview_scene_of(_report(context.previews, preview_id, key, repair=repair)),
        visitor=address_of(request),
    )
    return Response(
        data, media_type=BINARY_MEDIA_TYPE, headers={"Cache-Control": SCENE_CACHE_CONTROL}
    )


def _report(previews: Previews, preview_id: str, key: str, *, repair: bool) -> dict[str, Any]:
    """Return the report of a preview for the options of ``key``.

    Args:
        previews: Store of the previews.
        preview_id: Id of the preview.
        key: Key of the options.
        repair: True to add the cells of the offered repair.

    Raises:
        NoSuchPreviewError: If there is no such report.
    """
    if not OPTIONS_KEY.fullmatch(key):
        raise NoSuchPreviewError(preview_id)
    place = previews.place(preview_id, key)
    report = read_report(place)
    if report is None:
        raise NoSuchPreviewError(preview_id)
    return {**report, "added": cells_of_repair(place)} if repair else report
