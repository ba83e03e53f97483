"""The kiosk: chosen folds play in turn, each in a frame of its own."""

from __future__ import annotations

import asyncio
from typing import Annotated, Final

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import HTMLResponse, Response

from foldback.server.context import context_of, in_list_rate
from foldback.server.http.base_path import at
from foldback.server.pages.cards import shipped_folds
from foldback.server.pages.page import page, script_json
from foldback.server.pages.problem_page import not_found_page
from foldback.server.viewing.fold_lookup import find_now
from foldback.words.fold import ShownFold
from foldback.words.missing_pages import NO_FOLD

router = APIRouter(include_in_schema=False)
CHOSEN_FOLDS: Final = r"^([A-Za-z0-9_-]{1,64}(,[A-Za-z0-9_-]{1,64}){0,49})?$"
"""Matches ids of at most 50 folds, because each needs a query of the database."""


@router.get("/kiosk", response_class=HTMLResponse, dependencies=[Depends(in_list_rate)])
async def kiosk(
    request: Request, folds: Annotated[str, Query(pattern=CHOSEN_FOLDS)] = ""
) -> Response:
    """Return the kiosk page; if no folds are chosen, it plays those that come with foldback."""
    shown_folds = await asyncio.to_thread(_chosen, request, folds.split(",") if folds else [])
    if not shown_folds:
        return not_found_page(*NO_FOLD)
    return page("kiosk.html", exhibits=exhibits(shown_folds, at("/embed/{}")))


def exhibits(folds: list[ShownFold], address: str) -> str:
    """Return the folds as JSON for the page's script.

    Args:
        folds: The folds, in the order in which they play.
        address: Address of a fold's frame, with braces in place of its id.
    """
    return script_json(
        [
            {"id": fold.id, "name": fold.title, "src": address.replace("{}", fold.id)}
            for fold in folds
        ]
    )


def _chosen(request: Request, ids: list[str]) -> list[ShownFold]:
    if not ids:
        return shipped_folds(context_of(request).store)
    located_folds = (find_now(request, fold_id) for fold_id in ids)
    return [ShownFold.of(located.row) for located in located_folds if located is not None]
