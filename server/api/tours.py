"""Routes of tours: reading, storing and deleting the tour of a fold."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse, Response
from pydantic import ConfigDict, Field

from foldback.planner.plan.tour import Tour
from foldback.server.context import Here
from foldback.server.dependencies.described_answers import problems
from foldback.server.dependencies.owner_tokens import RequiredOwner, not_owner
from foldback.server.dependencies.request_bodies import described, json_body
from foldback.server.dependencies.requested_folds import (
    NOT_FOLD_OWNER,
    NOTHING_STORED,
    ExistingFold,
    OwnFrames,
    check_private,
    not_there,
)
from foldback.server.schemas import Body
from foldback.server.store.folds import NoSuchFoldError
from foldback.server.store.owned_items import write_beside
from foldback.server.store.schema import TourRow
from foldback.server.viewing.fold_lookup import with_figures
from foldback.server.viewing.fold_notes import tour_of

router = APIRouter(prefix="/api/folds/{fold_id}/tour", tags=["tours"])


class TourStop(Body):
    """One stop of a tour; frames and modules count from 1, as in the address of a page."""

    model_config = ConfigDict(extra="forbid")

    caption: str
    """Plain text of 1 to 300 characters."""
    frame: int
    """Frame of the timeline."""
    modules: list[int] | None = None
    """1 to 8 highlighted modules."""
    first: int | None = Field(default=None, alias="from")
    """First frame of a loop that plays at the stop."""
    last: int | None = Field(default=None, alias="to")
    """Last frame of that loop."""
    camera: str | None = None
    """Azimuth, elevation and distance, as in the address of a page."""
    follow: bool | None = None
    """False: the camera stays where it is while the chain moves."""
    colour: str | None = None
    """Quantity shown by the colours."""
    path: bool | None = None
    """True: modules are transparent and show the path."""


class TourBody(Body):
    """A tour in the format `foldback-tour/1`."""

    model_config = ConfigDict(extra="forbid")

    format: str
    """`foldback-tour/1`"""
    title: str
    """Plain text of 1 to 200 characters."""
    stops: list[TourStop]
    """1 to 50 stops."""


@router.get(
    "",
    summary="Get the tour of a fold",
    responses={200: {"model": TourBody}, **problems(404, 409)},
)
async def get_tour(
    request: Request,
    fold_id: str,
    context: Here,
    draft: Annotated[bool, Query(description="Return a draft even if a tour is stored.")] = False,
) -> JSONResponse:
    """Return the tour that the owner has stored, or a draft if there is none.

    A draft is written automatically. Its numbers come from the fold's certificate.
    """
    located = await asyncio.to_thread(context.store.find, fold_id)
    if located is None:
        raise NoSuchFoldError(fold_id)
    located = await with_figures(request, located)
    tour = await asyncio.to_thread(tour_of, context.store, located, draft=draft)
    if tour is None:
        raise not_there(await asyncio.to_thread(context.store.fold, fold_id), "tour")
    return JSONResponse(tour, headers={"Cache-Control": "private, no-cache"})


@router.put(
    "",
    summary="Store the tour of a fold",
    responses=problems(401, 403, 404, 409, 413, 422),
    openapi_extra=described(TourBody),
)
def put_tour(
    fold: ExistingFold,
    context: Here,
    owner: RequiredOwner,
    frames: OwnFrames,
    body: Annotated[dict[str, Any], json_body(dict)],
) -> TourBody:
    """Store a tour with the fold, in place of an earlier one. Gallery folds have drafts only."""
    tour = Tour.from_dict(body, frames=frames, modules=fold.modules).as_dict()
    if not write_beside(context.store, fold.id, owner, TourRow, tour):
        raise not_owner(NOT_FOLD_OWNER)
    return TourBody.model_validate(tour)


@router.delete(
    "", status_code=204, summary="Delete the tour of a fold", responses=problems(401, 403, 404)
)
def delete_tour(fold: ExistingFold, context: Here, owner: RequiredOwner) -> Response:
    """Delete the stored tour; afterwards the fold has its draft again."""
    check_private(fold, NOTHING_STORED)
    if not write_beside(context.store, fold.id, owner, TourRow, None):
        raise not_owner(NOT_FOLD_OWNER)
    return Response(status_code=204)
