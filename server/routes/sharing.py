"""Sharing: a fold in somebody else's page, in one file, and beside another fold."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse, Response

from planner.errors import TimelineError
from server.problems import Problem
from server.routes.facts import RUNNING, fold_facts
from server.routes.finding import Found, find_fold
from server.routes.pages import POLICY, not_found_page, page, rendered, script_json
from server.store import NoSuchFoldError
from web.client import client
from web.film import Film
from web.measured import curves_of
from web.recording import recording_of
from web.standalone import standalone_html

router = APIRouter(include_in_schema=False)
FOLD_ID: Final = r"^[A-Za-z0-9_-]{1,64}$"
AT_ONCE: Final = 2
_MAKING: Final = threading.BoundedSemaphore(AT_ONCE)


@router.get("/embed/view")
async def embedded_view(request: Request) -> Response:
    """Viser's client, for a frame in a frame."""
    page = await asyncio.to_thread(client)
    policy = page.policy.replace("frame-ancestors 'self'", _ancestors(request))
    headers = {"Content-Security-Policy": policy, "Cache-Control": "no-cache", "ETag": page.etag}
    if request.headers.get("if-none-match") == page.etag:
        return Response(status_code=304, headers=headers)
    return Response(page.html, media_type="text/html", headers=headers)


@router.get("/embed/{fold_id}", response_class=HTMLResponse)
async def embedded(request: Request, fold_id: str) -> Response:
    """A fold for the frame of another page: look, scrub, and a way to the whole page."""
    found = await find_fold(request.app, fold_id)
    if found is None:
        answer = not_found_page(
            "There is no such fold", "The link may be incomplete, or the fold was deleted."
        )
    else:
        facts = await asyncio.to_thread(fold_facts, found)
        answer = page("embed.html", facts=facts, facts_json=script_json(facts), details=False)
    policy = POLICY.replace("frame-ancestors 'self'", _ancestors(request))
    answer.headers["Content-Security-Policy"] = policy
    return answer


@router.get("/compare", response_class=HTMLResponse)
async def compare(
    request: Request,
    a: Annotated[str, Query(pattern=FOLD_ID)],
    b: Annotated[str, Query(pattern=FOLD_ID)],
) -> Response:
    """Two folds on one playhead."""
    sides = [await find_fold(request.app, fold_id) for fold_id in (a, b)]
    if None in sides:
        return not_found_page(
            "One of these folds is not there", "The link may be incomplete, or it was deleted."
        )
    facts = [await asyncio.to_thread(fold_facts, side) for side in sides if side is not None]
    return page(
        "compare.html", sides=facts, facts_json=script_json(facts), details=False, comparing=True
    )


@router.get("/folds/{fold_id}/standalone.html")
async def standalone(request: Request, fold_id: str) -> Response:
    """The fold in one file that plays by itself."""
    found, film = await _finished(request, fold_id)
    facts = await asyncio.to_thread(fold_facts, found, api=False)
    data = await _made(lambda: _standalone(found.directory, film, facts))
    return _file(data, facts["name"], "html", "text/html")


@router.get("/folds/{fold_id}/recording.viser")
async def recording(request: Request, fold_id: str) -> Response:
    """The fold as viser's own client plays it."""
    found, film = await _finished(request, fold_id)
    data = await _made(lambda: recording_of(film))
    return _file(data, found.row.name, "viser", "application/octet-stream")


def _standalone(directory: Path, film: Film, facts: dict[str, Any]) -> bytes:
    try:
        curves = curves_of(directory)
    except (TimelineError, OSError):
        curves = None
    return standalone_html(film, _page, facts, curves=curves)


def _page(**values: Any) -> str:
    return rendered("standalone.html", details=True, **values)


async def _finished(request: Request, fold_id: str) -> tuple[Found, Film]:
    found = await find_fold(request.app, fold_id)
    if found is None:
        raise NoSuchFoldError(fold_id)
    films = request.app.state.context.films
    film = await asyncio.to_thread(films.get, found.directory / "timeline.zarr")
    if found.row.status in RUNNING or film is None or not len(film):
        raise Problem(
            409,
            "not-ready",
            f"There is nothing to take away yet: the fold is {found.row.status}.",
            headers={"Retry-After": "2"},
        )
    return found, film


async def _made(make: Any) -> bytes:
    """What takes seconds and memory to make, a few at once."""
    if not _MAKING.acquire(blocking=False):
        raise Problem(
            503,
            "busy",
            "Other files are being made just now; try again in a moment.",
            headers={"Retry-After": "3"},
        )
    try:
        return await asyncio.to_thread(make)
    except TimelineError as error:
        raise Problem(409, "not-ready", str(error), headers={"Retry-After": "1"}) from error
    finally:
        _MAKING.release()


def _file(data: bytes, name: str, kind: str, media_type: str) -> Response:
    stem = "".join(c if c.isascii() and c.isalnum() else "-" for c in name).strip("-")[:60]
    headers = {
        "Content-Disposition": f'attachment; filename="{stem or "fold"}.{kind}"',
        # Opened in place it would run as a page of this origin.
        "Content-Security-Policy": "sandbox; default-src 'none'",
    }
    return Response(data, media_type=media_type, headers=headers)


def _ancestors(request: Request) -> str:
    settings = request.app.state.context.settings
    origins = settings.embed_origins if settings is not None else ()
    return " ".join(["frame-ancestors 'self'", *origins])
