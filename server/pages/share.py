"""Sharing: a fold in another site's page, in one file, and beside another fold."""

from __future__ import annotations

import asyncio
import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse, Response

from foldback.planner.errors import DamagedError, TimelineError
from foldback.planner.parameters.parameters import FLOATING
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.storage.file_names import PLAN, TIMELINE
from foldback.planner.verification.integrity import check
from foldback.server.errors import Conflict
from foldback.server.http.client_address import address_of
from foldback.server.http.downloads import download
from foldback.server.pages.facts import FoldFacts, fold_facts, script_facts
from foldback.server.pages.page import page, policy_of_pages, rendered, script_json
from foldback.server.pages.player_data import view_page
from foldback.server.pages.problem_page import no_such_page
from foldback.server.store.fold_files import NoSuchFoldError
from foldback.server.store.fold_source import FoldSource, LocatedFold
from foldback.server.store.object_store import TIMELINE_HEAD
from foldback.server.viewing.fold_lookup import find_fold, found_fold, viewing_of, with_figures
from foldback.server.viewing.fold_notes import steps_in, tour_of, values_of
from foldback.web.pictures.table_top import TableTop
from foldback.web.timeline.figures import FIGURES, curves_of, table_forces
from foldback.web.timeline.shared_views import unless_replaced
from foldback.web.timeline.view import TimelineView
from foldback.web.viser.client import client
from foldback.web.viser.recording import recording_of
from foldback.web.viser.standalone import Render, standalone_html, standalone_scripts
from foldback.words.fold import RUNNING_STATUSES
from foldback.words.missing_pages import NO_FOLD, NO_PAIR

router = APIRouter(include_in_schema=False)
SHARED_FOLD_ID: Final = r"^[A-Za-z0-9_-]{1,64}$"


@router.get("/embed/view")
async def embedded_view(request: Request) -> Response:
    """Return viser's page, which an embedded fold shows in an inner frame."""
    page = await asyncio.to_thread(view_page)
    policy = client().policy.replace("frame-ancestors 'self'", _ancestors(request))
    return page.response(request, {"Content-Security-Policy": policy})


@router.get("/embed/{fold_id}", response_class=HTMLResponse)
async def embedded(request: Request, fold_id: str) -> Response:
    """Return the page of a fold for a frame on another site; it links to the full page."""
    located = await find_fold(request, fold_id)
    if located is None:
        answer = no_such_page(request, NO_FOLD)
    else:
        # A client that may see this fold need not have the link of the recorded one.
        facts = await asyncio.to_thread(fold_facts, replace(located, recorded=None))
        answer = page(
            "embed.html", facts=facts, facts_json=script_json(script_facts(facts)), details=False
        )
    policy = policy_of_pages().replace("frame-ancestors 'self'", _ancestors(request))
    answer.headers["Content-Security-Policy"] = policy
    return answer


@router.get("/compare", response_class=HTMLResponse)
async def compare(
    request: Request,
    a: Annotated[str, Query(pattern=SHARED_FOLD_ID)],
    b: Annotated[str, Query(pattern=SHARED_FOLD_ID)],
) -> Response:
    """Return the page that plays two folds side by side."""
    sides = [await find_fold(request, fold_id) for fold_id in (a, b)]
    if None in sides:
        return no_such_page(request, NO_PAIR)
    facts = [await asyncio.to_thread(fold_facts, side) for side in sides if side is not None]
    return page(
        "compare.html",
        sides=facts,
        facts_json=script_json([script_facts(side) for side in facts]),
        details=False,
        comparing=True,
    )


@router.get("/folds/{fold_id}/standalone.html")
async def standalone(request: Request, fold_id: str) -> Response:
    """Return the fold as one HTML file that plays without a server; it is created once."""
    located = await with_figures(request, await _finished(request, fold_id))
    facts = await asyncio.to_thread(fold_facts, located, api=False)
    stored_parts = await asyncio.to_thread(_kept, viewing_of(request).store, located)
    path = await viewing_of(request).artifacts.file(
        fold_id,
        located.directory,
        "standalone.html",
        _of_view(
            located,
            lambda timeline: standalone_page(
                located, timeline, facts, _page, stored_parts=stored_parts
            ),
        ),
        of=TIMELINE_HEAD,
        edition=await asyncio.to_thread(_edition, facts, stored_parts),
        visitor=address_of(request),
    )
    return _file(path, facts["name"], "html", "text/html")


@router.get("/folds/{fold_id}/recording.viser")
async def recording(request: Request, fold_id: str) -> Response:
    """Return the fold as a recording for viser's client; it is created once."""
    located = await _finished(request, fold_id)
    path = await viewing_of(request).artifacts.file(
        fold_id,
        located.directory,
        "recording.viser",
        _of_view(located, lambda timeline: recording_of(timeline, _table(located, timeline))),
        of=TIMELINE_HEAD,
        visitor=address_of(request),
    )
    return _file(path, located.row.name, "viser", "application/octet-stream")


def _of_view(located: LocatedFold, make: Callable[[TimelineView], bytes]) -> Callable[[], bytes]:
    """Return a function that reads a separate view, because the shared one caches other frames."""

    def made() -> bytes:
        try:
            return make(TimelineView(result_path(located.directory, TIMELINE)))
        except DamagedError:
            raise
        except TimelineError as error:
            raise Conflict("not-ready", str(error), retry_after_s=1) from error

    return made


def standalone_page(
    located: LocatedFold,
    timeline: TimelineView,
    facts: FoldFacts,
    render: Render,
    *,
    view: str | None = None,
    stored_parts: dict[str, Any],
) -> bytes:
    """Return a fold's page that plays without a server: see ``standalone_html``."""
    curves = forces = None
    with unless_replaced(OSError):
        curves, forces = (
            curves_of(located.directory, located.derived_dir),
            table_forces(located.directory),
        )
    plan = located.directory / PLAN
    check(located.directory, PLAN)
    return standalone_html(
        timeline,
        render,
        facts,
        plan=plan if located.row.status == "verified" and plan.exists() else None,
        curves=curves,
        forces=forces,
        table=_table(located, timeline),
        view=view,
        stored_parts=stored_parts,
    )


def _table(located: LocatedFold, timeline: TimelineView) -> TableTop | None:
    """Return the table under a fold; None if it floats."""
    return None if located.row.world == FLOATING else timeline.table()


def _kept(store: FoldSource, located: LocatedFold) -> dict[str, Any]:
    """Return the tour of a fold, the module values that are stored with it, and its steps."""
    return {
        "tour": tour_of(store, located),
        "values": values_of(store, located),
        "steps": steps_in(located),
    }


def _edition(facts: FoldFacts, stored_parts: dict[str, Any]) -> str:
    """Return an edition that changes with a standalone page's content and scripts."""
    content = json.dumps(
        [version("foldback"), standalone_scripts(), facts, stored_parts], sort_keys=True
    )
    return hashlib.sha256(content.encode()).hexdigest()[:16]


def _page(**values: object) -> str:
    return rendered("standalone.html", details=True, **values)


async def _finished(request: Request, fold_id: str) -> LocatedFold:
    located = await asyncio.to_thread(found_fold, request, fold_id)
    if located.alternative_to is not None:
        raise NoSuchFoldError(fold_id)
    if located.row.status not in RUNNING_STATUSES:
        await asyncio.to_thread(check, located.directory, TIMELINE, FIGURES)
    timelines = viewing_of(request).timelines
    timeline = await asyncio.to_thread(timelines.get, result_path(located.directory, TIMELINE))
    if located.row.status in RUNNING_STATUSES or timeline is None or not len(timeline):
        raise Conflict(
            "not-ready",
            "There is nothing to download yet: the fold is {status}.",
            retry_after_s=2,
            status=located.row.status,
        )
    return located


def _file(path: Path, name: str, kind: str, media_type: str) -> Response:
    return download(path, media_type, name, f".{kind}", {"Cache-Control": "private, no-cache"})


def _ancestors(request: Request) -> str:
    settings = viewing_of(request).settings
    origins = settings.embed_origins if settings is not None else ()
    return " ".join(["frame-ancestors 'self'", *origins])
