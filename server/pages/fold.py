"""The page of a fold."""

from __future__ import annotations

import asyncio
import json
from functools import lru_cache
from pathlib import Path

import numpy as np
from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, JSONResponse, Response

from foldback.planner.chain.chain_attributes import chain_from_attributes
from foldback.planner.errors import UNREADABLE, PlannerError
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.storage.file_names import CHAIN, PLAN
from foldback.planner.verification.integrity import damaged_among
from foldback.server.context import context_of
from foldback.server.http.response_cache import mark
from foldback.server.pages.facts import FoldFacts, fold_facts, script_facts
from foldback.server.pages.page import origin_of, page, script_json
from foldback.server.pages.privacy import visibility
from foldback.server.pages.problem_page import no_such_page
from foldback.server.processes.read_task import MAX_DRAWN_CELLS
from foldback.server.store.fold_source import LocatedFold
from foldback.server.viewing.fold_lookup import find_now, viewing_of
from foldback.web.pictures.isometric import isometric_svg
from foldback.web.pictures.isometric_modules import chain_svg
from foldback.web.pictures.picture_view import PictureView
from foldback.words.citation import bibtex
from foldback.words.fold import RUNNING_STATUSES
from foldback.words.missing_pages import NO_FOLD
from foldback.words.properties import settings_of

router = APIRouter(include_in_schema=False)


@router.get("/folds/{fold_id}", response_class=HTMLResponse)
async def fold_page(request: Request, fold_id: str) -> Response:
    """Return the page of a fold."""
    return await asyncio.to_thread(_fold_page, request, fold_id)


def _fold_page(request: Request, fold_id: str) -> Response:
    located = find_now(request, fold_id)
    if located is None:
        return no_such_page(request, NO_FOLD)
    mark(request, located.row)
    facts = _facts(request, located)
    over = located.row.status not in RUNNING_STATUSES
    drawable = not (over and damaged_among(located.directory, [CHAIN]))
    return page(
        "fold.html",
        listed=located.row.public,
        facts=facts,
        facts_json=script_json(script_facts(facts)),
        drawing=drawing_in(located.directory) if drawable else "",
        details=True,
        has_service=viewing_of(request).settings is not None,
        origin=(origin := origin_of(request)),
        citation=_citation(located, f"{origin}/folds/{fold_id}") if facts["purposes"] else "",
        view=_asked_view(request),
    )


def _citation(located: LocatedFold, address: str) -> str:
    """Return the BibTeX entry of a fold at an address."""
    versions = settings_of(located.directory / PLAN).get("versions", {})
    return bibtex(located.row, address=address, version=versions.get("foldback"))


def _asked_view(request: Request) -> str:
    """Return the query string for a picture of the requested view; empty without one."""
    view = request.query_params.get("view", "")
    return f"?view={view}" if PictureView.from_short(view) else ""


@router.get("/folds/{fold_id}/facts")
async def facts_of_fold(request: Request, fold_id: str) -> Response:
    """Return the texts about a fold that an open page shows when the fold ends."""

    def answer() -> Response:
        located = find_now(request, fold_id)
        if located is None:
            return JSONResponse({"detail": "Fold not found."}, status_code=404)
        return JSONResponse(_facts(request, located), headers={"Cache-Control": "no-store"})

    return await asyncio.to_thread(answer)


def drawing_in(directory: Path) -> str:
    """Return the drawing of a directory's folded shape; empty while it is unknown."""
    for path in (result_path(directory, CHAIN), directory / "cells.json"):
        if path.exists():
            return _drawing_of(path, path.name == CHAIN)
    return ""


@lru_cache(maxsize=256)
def _drawing_of(path: Path, is_chain: bool) -> str:
    """Return a drawing of a chain, or of the cells that were stored when the upload was read."""
    try:
        noted = json.loads(path.read_text(encoding="utf-8"))
        if is_chain:
            chain = chain_from_attributes(noted)
            return chain_svg(chain) if len(chain) <= MAX_DRAWN_CELLS else ""
        cells = np.array(noted, dtype=int).reshape(-1, 3)
    except (PlannerError, *UNREADABLE):
        return ""  # the page is usable without a drawing
    return isometric_svg(cells) if 0 < len(cells) <= MAX_DRAWN_CELLS else ""


def _facts(request: Request, located: LocatedFold) -> FoldFacts:
    if viewing_of(request).settings is None:
        return fold_facts(located, api=False)
    context = context_of(request)
    return fold_facts(
        located,
        embed=bool(context.settings.embed_origins),
        lifetime_text=visibility(context.settings, located.row),
        expected=context.estimates.total_s,
    )
