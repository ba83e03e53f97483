"""The landing page, and the fold that plays on it."""

from __future__ import annotations

import asyncio
from functools import cache
from typing import Final

from fastapi import APIRouter, Depends, Request
from fastapi.responses import HTMLResponse, Response

from foldback.server.context import context_of, in_list_rate
from foldback.server.errors import READ_ONLY_WORDS
from foldback.server.http.downloads import BINARY_MEDIA_TYPE, Asset, revalidated
from foldback.server.pages.cards import selected
from foldback.server.pages.page import origin_of, page
from foldback.server.pages.pictures import picture_answer
from foldback.server.pages.privacy import visibility
from foldback.server.store.folds import Store
from foldback.web.pictures.shipped_pictures import shipped_pictures
from foldback.web.static_files import STATIC

router = APIRouter(include_in_schema=False)

FEATURED_BATCH: Final = STATIC.parent / "featured.batch"
FEATURED_SHAPE: Final = "wrench-160"


@router.get("/", response_class=HTMLResponse, dependencies=[Depends(in_list_rate)])
async def landing(request: Request) -> Response:
    """Return the landing page."""
    context = context_of(request)
    featured = await asyncio.to_thread(_featured, context.store)
    pictures = await asyncio.to_thread(shipped_pictures)
    return page(
        "landing.html",
        listed=True,
        shapes=selected(context.gallery),
        count=len(context.gallery.shapes()),
        featured=featured,
        kept=visibility(context.settings),
        origin=origin_of(request),
        read_only=READ_ONLY_WORDS if context.settings.read_only else None,
        still=pictures[f"{FEATURED_SHAPE}-480.svg"].decode(),
    )


@router.get("/featured/bundle")
async def featured_bundle(request: Request) -> Response:
    """Return the metadata of the chain on the landing page."""
    return (await asyncio.to_thread(_bundle)).response(request)


@router.get("/featured/picture.png")
async def featured_picture() -> Response:
    """Return the picture that chat programs show beside a link to the landing page."""
    return picture_answer(shipped_pictures()["featured.png"], listed=True)


@router.get("/featured/batch")
async def featured_batch(request: Request) -> Response:
    """Return the recorded fold of the landing page (see ``examples/make_featured.py``)."""
    return revalidated(request, await asyncio.to_thread(_recorded), BINARY_MEDIA_TYPE)


@cache
def _bundle() -> Asset:
    return Asset.of(shipped_pictures()["featured.bundle"], BINARY_MEDIA_TYPE)


@cache
def _recorded() -> bytes:
    return FEATURED_BATCH.read_bytes()


def _featured(store: Store) -> str | None:
    """Return the fold that plays on the landing page, if its shape has been folded here."""
    rows = [
        row
        for row in store.list_public()
        if row.shape == FEATURED_SHAPE and row.status == "verified"
    ]
    return rows[-1].id if rows else None
