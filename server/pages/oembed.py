"""oEmbed (https://oembed.com): how other sites show a fold whose link somebody pastes."""

from __future__ import annotations

import re
from html import escape
from typing import Annotated, Final
from urllib.parse import urlsplit

from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse, Response

from server.api.finding import find_fold, viewing_of
from server.pages.page import origin_of

router = APIRouter(include_in_schema=False)

FOLD_PATH: Final = re.compile(r"/(?:folds|embed)/([^/]+)")
"""Path of a fold's page; ``find_fold`` checks the id in it."""
WIDTH_PX: Final = 720
HEIGHT_PX: Final = 480
"""Size of a frame for which the asking site names no bounds, as in *Share*."""
MIN_PX: Final = 200
"""Smallest side of a frame in which the controls still leave room for the picture."""
MAX_ADDRESS: Final = 2000
"""Characters of an address that is looked up; a longer one is refused. Chosen."""
PICTURE: Final = (1200, 630)
"""Width and height of a fold's picture in pixels: ``SIZE`` of ``web.pictures.social_picture``,
whose import would load Pillow and numba into the web process."""


@router.get("/oembed")
async def oembed(
    request: Request,
    url: Annotated[str, Query(max_length=MAX_ADDRESS)],
    wanted: Annotated[str, Query(alias="format", max_length=10)] = "json",
    maxwidth: Annotated[int, Query(ge=1, le=10_000)] = WIDTH_PX,
    maxheight: Annotated[int, Query(ge=1, le=10_000)] = HEIGHT_PX,
) -> Response:
    """Describe the fold behind a link of this service.

    Sites that may embed folds get a frame; all others get the name and a picture. The answer is 404
    if the link is not one of this service, and 501 for other formats than JSON, as oEmbed requires.
    """
    if wanted != "json":
        return Response("Only JSON is served.", status_code=501, media_type="text/plain")
    origin = origin_of(request)
    fold_id = _fold_in(url, origin)
    found = await find_fold(request, fold_id) if fold_id is not None else None
    if found is None:
        return Response("No fold was found at this link.", status_code=404, media_type="text/plain")
    row = found.row
    about = {
        "version": "1.0",
        "provider_name": "foldback",
        "provider_url": origin,
        "title": row.title,
        "thumbnail_url": f"{origin}/folds/{row.id}/picture.png",
        "thumbnail_width": PICTURE[0],
        "thumbnail_height": PICTURE[1],
    }
    settings = viewing_of(request).settings
    if settings is None or not settings.embed_origins:
        return JSONResponse({"type": "link", **about})
    width, height = max(MIN_PX, min(maxwidth, WIDTH_PX)), max(MIN_PX, min(maxheight, HEIGHT_PX))
    frame = (
        f'<iframe src="{origin}/embed/{row.id}" title="{escape(row.title)}" width="{width}" '
        f'height="{height}" style="border:0" allow="fullscreen" loading="lazy"></iframe>'
    )
    return JSONResponse({"type": "rich", "html": frame, "width": width, "height": height, **about})


def _fold_in(url: str, origin: str) -> str | None:
    """Return the id of the fold that a link of this service leads to, or None."""
    try:
        address = urlsplit(url)
    except ValueError:
        return None
    match = FOLD_PATH.fullmatch(address.path)
    same = f"{address.scheme}://{address.netloc}" == origin
    return match[1] if match is not None and same else None
