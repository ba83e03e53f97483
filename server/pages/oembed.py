"""oEmbed (https://oembed.com): the frame that other sites show for a link to a fold."""

from __future__ import annotations

import re
from html import escape
from typing import Annotated, Final

from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse, Response

from foldback.server.pages.page import origin_of
from foldback.server.viewing.fold_lookup import find_fold, viewing_of
from foldback.web.pictures import SOCIAL_PICTURE_PX

router = APIRouter(include_in_schema=False)

FOLD_PATH: Final = r"/(?:folds|embed)/([^/?#]+)([?#].*)?"
"""Matches the path of a fold's page or of its embeddable page, with a query; the first group is the
fold's id."""
FRAME_WIDTH_PX: Final = 720
"""Maximum and default width of the frame in which other sites embed a fold (oEmbed), in pixels; the
*Share* dialog proposes the same."""
FRAME_HEIGHT_PX: Final = 480
"""Maximum and default height of the frame in which other sites embed a fold (oEmbed), in pixels;
the *Share* dialog proposes the same."""
MIN_FRAME_SIDE_PX: Final = 200
"""Minimum width and height of the frame in which other sites embed a fold (oEmbed), in pixels."""


@router.get("/oembed")
async def oembed(
    request: Request,
    url: Annotated[str, Query(max_length=2000)],
    answer_format: Annotated[str, Query(alias="format", max_length=10)] = "json",
    maxwidth: Annotated[int, Query(ge=1, le=10_000)] = FRAME_WIDTH_PX,
    maxheight: Annotated[int, Query(ge=1, le=10_000)] = FRAME_HEIGHT_PX,
) -> Response:
    """Describe the fold behind a link of this service.

    Sites that may embed folds get a frame; other sites get the name and a picture. The answer is
    404 if the link leads elsewhere, and 501 for formats other than JSON, as oEmbed requires.
    """
    if answer_format != "json":
        answer = f"got the format {answer_format!r}, expected 'json'."
        return Response(answer, status_code=501, media_type="text/plain")
    origin = origin_of(request)
    link = re.fullmatch(re.escape(origin) + FOLD_PATH, url)
    located = await find_fold(request, link[1]) if link else None
    if located is None:
        return Response("No fold was found at this link.", status_code=404, media_type="text/plain")
    row = located.row
    about = {
        "version": "1.0",
        "provider_name": "foldback",
        "provider_url": origin,
        "title": row.title,
        "thumbnail_url": f"{origin}/folds/{row.id}/picture.png",
        "thumbnail_width": SOCIAL_PICTURE_PX[0],
        "thumbnail_height": SOCIAL_PICTURE_PX[1],
    }
    settings = viewing_of(request).settings
    if settings is None or not settings.embed_origins:
        return JSONResponse({"type": "link", **about})
    width = max(MIN_FRAME_SIDE_PX, min(maxwidth, FRAME_WIDTH_PX))
    height = max(MIN_FRAME_SIDE_PX, min(maxheight, FRAME_HEIGHT_PX))
    frame = (
        f'<iframe src="{origin}/embed/{row.id}" title="{escape(row.title)}" width="{width}" '
        f'height="{height}" style="border:0" allow="fullscreen" loading="lazy"></iframe>'
    )
    return JSONResponse({"type": "rich", "html": frame, "width": width, "height": height, **about})
