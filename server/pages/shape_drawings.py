"""Drawings of gallery shapes."""

from __future__ import annotations

import asyncio
from functools import cache

from fastapi import APIRouter, Request
from fastapi.responses import Response

from planner.chain.chain import Chain
from planner.chain.path import Path as CellPath
from planner.errors import InputError, PlannerError
from planner.readers import read
from planner.readers.gallery import Gallery, GalleryShape
from server.api.context import context_of
from server.http.security import INDEXED_HEADERS
from server.pages.page import drawing
from web.pictures.isometric_modules import chain_svg
from web.pictures.shipped_pictures import shipped_pictures

router = APIRouter(include_in_schema=False)


@router.get("/shapes/{name}.svg")
async def drawing_of_shape(request: Request, name: str) -> Response:
    """Return the drawing of a gallery shape."""
    svg = await asyncio.to_thread(drawing_of, context_of(request).gallery, name, 160)
    answer = drawing(svg or "", "public, max-age=3600")
    if svg is not None:
        answer.headers.update(INDEXED_HEADERS)
    return answer


def drawing_of(gallery: Gallery, name: str, size: int) -> str | None:
    """Return the drawing of a gallery shape; None if there is none or it cannot be drawn."""
    if (shape := gallery.shape(name)) is None:
        return None
    shipped = shipped_pictures().get(f"{name}-{size}.svg")
    return _svg_of(shape, size) if shipped is None else shipped.decode()


@cache
def _svg_of(shape: GalleryShape, size: int) -> str | None:
    try:
        return chain_svg(chain_of(shape), size=size)
    except PlannerError:
        return None


def chain_of(shape: GalleryShape) -> Chain:
    """Return the chain of a gallery shape."""
    match read(shape.data, filename=shape.filename):
        case Chain() as chain:
            return chain
        case CellPath() as path:
            return Chain.from_path(path)
        case other:
            got = type(other).__name__.lower()
            detail = f"{shape.name} is a {got}, expected a path or a chain."
            raise InputError("not-a-path", detail)
