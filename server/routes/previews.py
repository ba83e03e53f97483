"""Previews: the page that shows a shape before it is folded, its 3D view, and the editor."""

from __future__ import annotations

import asyncio
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fastapi import APIRouter, Request, WebSocket
from fastapi.responses import HTMLResponse, Response

from server.addresses import address_of
from server.previews import KEY, NoSuchPreviewError, Previews, read_report
from server.routes.facts import shown_name
from server.routes.pages import new_visitor, not_found_page, page, script_json
from server.routes.viewers import (
    OpenViewer,
    carry_control,
    carry_view,
    client_page,
)
from web.preview import PreviewPlayer
from web.preview_drawing import preview_svg
from web.viewers import VISITOR, Viewer

if TYPE_CHECKING:
    from collections.abc import Mapping

    from viser import ViserServer

router = APIRouter(include_in_schema=False)


@router.get("/shapes/new", response_class=HTMLResponse)
async def editor(request: Request) -> Response:
    """The editor: cells painted layer by layer."""
    return page("editor.html")


@router.get("/previews/{preview_id}", response_class=HTMLResponse)
async def preview_page(request: Request, preview_id: str) -> Response:
    """The page of a preview."""
    context = request.app.state.context
    try:
        filename = await asyncio.to_thread(context.previews.filename, preview_id)
    except NoSuchPreviewError:
        return not_found_page(
            "This preview is not there any more",
            "Previews are kept for a while only. Send the file again to get a new one.",
        )
    name = shown_name((filename or "shape").rpartition(".")[0] or filename or "shape")
    facts: dict[str, Any] = {
        "id": preview_id,
        "name": name,
        "visitor": new_visitor(),
        "most_modules": context.settings.max_modules,
    }
    return page("preview.html", facts=facts, facts_json=script_json(facts))


@router.get("/previews/{preview_id}/drawing.svg")
async def drawing_of_preview(request: Request, preview_id: str, key: str = "") -> Response:
    """A drawing of what came of the wishes of that key, in nobody's words but ours."""
    previews = request.app.state.context.previews
    svg = await asyncio.to_thread(_drawing, previews, preview_id, key)
    if svg is None:
        return Response("not found", status_code=404, media_type="text/plain")
    headers = {
        "Cache-Control": "private, max-age=3600",
        "Content-Security-Policy": "default-src 'none'",
    }
    return Response(svg, media_type="image/svg+xml", headers=headers)


@router.get("/previews/{preview_id}/view/{visitor}/")
async def view_page(request: Request, preview_id: str, visitor: str) -> Response:
    """Viser's client, to be framed by the preview's page."""
    return client_page(request, await _known(request.app, preview_id, visitor))


@router.websocket("/previews/{preview_id}/view/{visitor}")
async def view_socket(websocket: WebSocket, preview_id: str, visitor: str) -> None:
    """Carries viser's messages between a browser and the visitor's viser server."""
    await carry_view(websocket, _opener(websocket, preview_id, visitor))


@router.websocket("/previews/{preview_id}/control/{visitor}")
async def control_socket(websocket: WebSocket, preview_id: str, visitor: str) -> None:
    """Carries what the page wants shown to the visitor's scene."""
    await carry_control(websocket, _opener(websocket, preview_id, visitor))


def _drawing(previews: Previews, preview_id: str, key: str) -> str | None:
    if not KEY.fullmatch(key):
        return None
    try:
        return _drawing_at(previews.directory(preview_id) / key)
    except (NoSuchPreviewError, LookupError, ValueError):
        return None


@lru_cache(maxsize=32)
def _drawing_at(place: Path) -> str | None:
    report = read_report(place)
    if report is None:
        raise LookupError(place)  # so that it is looked for again
    return preview_svg(report)


async def _known(app: Any, preview_id: str, visitor: str) -> bool:
    if not VISITOR.fullmatch(visitor):
        return False
    try:
        await asyncio.to_thread(app.state.context.previews.directory, preview_id)
    except NoSuchPreviewError:
        return False
    return True


def _opener(websocket: WebSocket, preview_id: str, visitor: str) -> OpenViewer:
    context = websocket.app.state.context

    def report(key: str) -> Mapping[str, Any] | None:
        if not KEY.fullmatch(key):
            return None
        return read_report(context.previews.directory(preview_id) / key)

    def make(server: ViserServer) -> PreviewPlayer:
        return PreviewPlayer(server, report)

    async def open_viewer() -> Viewer | None:
        if not await _known(websocket.app, preview_id, visitor):
            return None
        what, address = f"preview {preview_id}", address_of(websocket)
        return await asyncio.to_thread(context.viewers.opened, what, visitor, make, address=address)

    return open_viewer
