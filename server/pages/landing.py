"""The landing page, and the fold that plays on it."""

from __future__ import annotations

import asyncio
from functools import cache
from typing import Final

from fastapi import APIRouter, Depends, Request
from fastapi.responses import HTMLResponse, Response

from planner.chain.chain import Chain
from planner.readers.gallery import Gallery
from server.api.context import context_of, in_list_rate
from server.errors import READ_ONLY_WORDS
from server.http.downloads import BINARY_MEDIA_TYPE, revalidated
from server.pages.cards import cards, selected
from server.pages.page import origin_of, page, templates
from server.pages.pictures import picture_answer
from server.pages.privacy import visibility
from server.pages.problem_page import DRAWN_CELLS
from server.pages.shape_drawings import chain_of, drawing_of
from server.store.folds import Store
from web.pictures.isometric import isometric_svg
from web.pictures.shipped_pictures import shipped_pictures
from web.static_files import STATIC
from web.viser.scene_bundle import bundle_of

router = APIRouter(include_in_schema=False)

FEATURED_BATCH: Final = STATIC.parent / "featured.batch"
FEATURED_SHAPE: Final = "wrench-160"


@router.get("/", response_class=HTMLResponse, dependencies=[Depends(in_list_rate)])
async def landing(request: Request) -> Response:
    """Return the landing page."""
    context = context_of(request)
    featured = await asyncio.to_thread(_featured, context.store)
    still = await asyncio.to_thread(drawing_of, context.gallery, FEATURED_SHAPE, 480)
    return page(
        "landing.html",
        listed=True,
        shapes=selected(context.gallery),
        count=len(cards(context.gallery)),
        featured=featured,
        kept=visibility(context.settings),
        origin=origin_of(request),
        preparing=await asyncio.to_thread(context.leases.preparing),
        read_only=READ_ONLY_WORDS if context.settings.read_only else None,
        still=still or isometric_svg(DRAWN_CELLS),
    )


@router.get("/featured/bundle")
async def featured_bundle(request: Request) -> Response:
    """Return the metadata of the chain on the landing page."""
    gallery = context_of(request).gallery
    return revalidated(request, await asyncio.to_thread(_bundle, gallery), BINARY_MEDIA_TYPE)


@router.get("/featured/picture.png")
async def featured_picture() -> Response:
    """Return the picture that chat programs show beside a link to the landing page."""
    return picture_answer(shipped_pictures()["featured.png"], listed=True)


@router.get("/featured/batch")
async def featured_batch(request: Request) -> Response:
    """Return the recorded fold of the landing page (see ``examples/make_featured.py``)."""
    return revalidated(request, await asyncio.to_thread(_recorded), BINARY_MEDIA_TYPE)


@cache
def _recorded() -> bytes:
    return FEATURED_BATCH.read_bytes()


def warm_up(gallery: Gallery) -> None:
    """Draw the shape of the landing page and load templates, so that first requests are fast."""
    bundle_of(_featured_chain(gallery))
    drawing_of(gallery, FEATURED_SHAPE, 480)
    for name in ("landing.html", "fold.html", "gallery.html"):
        templates().get_template(name)


@cache
def _bundle(gallery: Gallery) -> bytes:
    return shipped_pictures().get("featured.bundle") or bundle_of(_featured_chain(gallery))


@cache
def _featured_chain(gallery: Gallery) -> Chain:
    shape = gallery.shape(FEATURED_SHAPE)
    assert shape is not None, f"{FEATURED_SHAPE} is in the gallery"
    return chain_of(shape)


def _featured(store: Store) -> str | None:
    """Return the fold that plays on the landing page, if its shape has been folded here."""
    rows = [
        row
        for row in store.list_public()
        if row.shape == FEATURED_SHAPE and row.status == "verified"
    ]
    return rows[-1].id if rows else None
