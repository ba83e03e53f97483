"""Pictures: what networks show beside a link to a fold."""

from __future__ import annotations

import asyncio
import json
import threading
from pathlib import Path
from typing import Final

from fastapi import APIRouter, Request
from fastapi.responses import Response

from planner.errors import PlannerError
from planner.files import write_whole
from planner.timeline import chain_from_attributes
from server.routes.finding import find_fold

router = APIRouter(include_in_schema=False)

NAME: Final = "picture.png"
DRAWING: Final = threading.Lock()
"""One is drawn at a time: a crowd that comes with a link waits for the first one's."""


@router.get("/folds/{fold_id}/picture.png")
async def picture_of_fold(request: Request, fold_id: str) -> Response:
    """The folded shape, 1200×630; drawn once."""
    found = await find_fold(request.app, fold_id)
    data = None if found is None else await asyncio.to_thread(_picture, found.directory)
    if data is None:
        return Response("not found", status_code=404, media_type="text/plain")
    return picture_answer(data)


def picture_answer(data: bytes) -> Response:
    """A picture that other sites may show."""
    headers = {
        "Cache-Control": "public, max-age=86400",
        "Content-Security-Policy": "default-src 'none'",
        "Cross-Origin-Resource-Policy": "cross-origin",  # it is made to be shown elsewhere
    }
    return Response(data, media_type="image/png", headers=headers)


def _picture(directory: Path) -> bytes | None:
    """The picture in a fold's directory, drawn if it is not there; None while there is no chain."""
    path = directory / NAME
    with DRAWING:
        try:
            return path.read_bytes()
        except OSError:
            pass
        try:
            chain = chain_from_attributes(json.loads((directory / "chain.json").read_bytes()))
        except (PlannerError, OSError, ValueError, KeyError):
            return None
        # Drawing brings kernels along that the start of the server need not wait for.
        from web.social_picture import social_picture

        data = social_picture(chain)
        write_whole(path, data)
        return data
