"""The gallery: all example shapes on a page, their drawings, and folding without a script."""

from __future__ import annotations

import asyncio
from functools import cache, lru_cache
from typing import Final

from fastapi import APIRouter, Depends, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from foldback.planner.errors import InputError
from foldback.planner.parameters.parameters import World
from foldback.planner.pipeline.request import FoldRequest
from foldback.server.api.folds import post_fold
from foldback.server.context import context_of, in_list_rate
from foldback.server.errors import ServiceError, refusal_of
from foldback.server.http.downloads import Asset
from foldback.server.http.problems import Problem
from foldback.server.http.security import INDEXED_HEADERS
from foldback.server.pages.cards import (
    CardFacts,
    FoldStatus,
    GalleryFilter,
    fold_statuses,
    kinds,
    shipped_folds,
)
from foldback.server.pages.page import not_found, origin_of, page
from foldback.server.pages.problem_page import not_found_page
from foldback.server.store.owner import Claim
from foldback.server.submission.fold_inputs import Origin
from foldback.web.pictures.shipped_pictures import shipped_motion, shipped_pictures
from foldback.words.gallery import (
    CARD_STATUS_LABELS,
    CHAIN_LABELS,
    WORLD_LABELS,
    method_of,
    rest_of,
)

router = APIRouter(include_in_schema=False)

DRAWING_HEADERS: Final = {
    "Cache-Control": "public, max-age=3600",
    "Content-Security-Policy": "default-src 'none'",
    **INDEXED_HEADERS,
}
"""Headers of drawings of the example shapes, in which no script can run."""


@router.get("/gallery", response_class=HTMLResponse, dependencies=[Depends(in_list_rate)])
async def gallery_page(request: Request) -> Response:
    """Return the gallery; the query selects which example shapes are shown."""
    context = context_of(request)
    statuses = await asyncio.to_thread(fold_statuses, context.store)
    sieve = GalleryFilter.of(request.query_params)
    cards = [(card, statuses.get(card.name, FoldStatus())) for card in context.gallery.shapes()]
    shipped = await asyncio.to_thread(shipped_folds, context.store)
    facts = {card.name: CardFacts.of_shape(card, status) for card, status in cards}
    facts |= {fold.id: CardFacts.of_fold(fold) for fold in shipped}
    shown = {card_facts.module for card_facts in facts.values()}
    keys = {key for key, fold_facts in facts.items() if sieve.lets(fold_facts)}
    return page(
        "gallery.html",
        listed=True,
        origin=origin_of(request),
        cards=cards,
        card_facts=facts,
        wanted=keys,
        sieve=sieve,
        kinds=kinds(context.gallery),
        chains={name: label for name, label in CHAIN_LABELS.items() if name in shown},
        statuses=CARD_STATUS_LABELS,
        where=WORLD_LABELS,
        method_of=method_of,
        rest_of=rest_of,
        finished=shipped,
    )


@router.get("/shapes/{name}.svg")
async def drawing_of_shape(request: Request, name: str) -> Response:
    """Return the drawing of an example shape."""
    pictures = await asyncio.to_thread(shipped_pictures)
    file_name = f"{name}-160.svg"
    if file_name not in pictures:
        return not_found()
    return _compressed(file_name).response(request, DRAWING_HEADERS)


@router.get("/shapes/{name}/motion.svg")
async def motion_of_shape(request: Request, name: str) -> Response:
    """Return the moving drawing of a fold into an example shape."""
    asset = await asyncio.to_thread(_motion, name)
    return not_found() if asset is None else asset.response(request, DRAWING_HEADERS)


@lru_cache(maxsize=256)
def _motion(name: str) -> Asset | None:
    svg = shipped_motion(name)
    return None if svg is None else Asset.of(svg, "image/svg+xml")


@cache
def _compressed(file_name: str) -> Asset:
    return Asset.of(shipped_pictures()[file_name], "image/svg+xml")


@router.post("/gallery/{name}", response_class=HTMLResponse)
def fold_shape(request: Request, name: str, world: World = "floating") -> Response:
    """Fold an example shape and redirect to its fold, for browsers without scripts."""
    try:
        accepted = post_fold(
            http=request,
            context=context_of(request),
            claim=Claim.new(),
            origin=Origin(shape=name),
            fold_request=FoldRequest(world=world),
        )
    except (ServiceError, InputError) as error:
        problem = Problem.of(refusal_of(error))
        heading = "This shape can't be folded"
        return not_found_page(heading, problem.text, status_code=problem.status)
    return RedirectResponse(accepted.links.page, status_code=303)
