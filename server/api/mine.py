"""Routes of an owner's folds, previews and movies."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Final
from urllib.parse import urlencode

import msgspec
from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import Response
from msgspec import Meta

from foldback.planner.chain.built_in_modules import words_named
from foldback.server.api.movies import MovieBody
from foldback.server.context import Here
from foldback.server.dependencies.described_answers import problems
from foldback.server.dependencies.owner_tokens import NewToken, RequiredOwner, not_owner
from foldback.server.dependencies.request_bodies import described, json_body
from foldback.server.errors import Malformed
from foldback.server.schemas import (
    Body,
    Fold,
    KeyReplaced,
    ModuleWordsBody,
    OwnedFolds,
    OwnedPreview,
    OwnedPreviews,
    moment,
)
from foldback.server.store.owned_items import folds_made, hand_over_all
from foldback.server.store.owner import Claim, Owner
from foldback.words.fold import ShownFold, shown_name

router = APIRouter(prefix="/api/mine", tags=["mine"])
CURSOR_PATTERN: Final = r"^[0-9]{1,12}(\.[0-9]{1,12})?,[A-Za-z0-9_-]{1,32}$"


class KeyRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The token that replaces another one."""

    owner_token: Annotated[
        NewToken | None,
        Meta(
            description="New token, at least 24 characters. If you choose the token yourself, you "
            "have it even if the response is lost. Default: a random token."
        ),
    ] = None


class OwnedMovie(Body):
    """A movie that was requested with this token."""

    title: str
    """Name of the movie's fold, as shown on pages."""
    created_at: datetime
    movie: MovieBody


class OwnedMovies(Body):
    """Movies of one owner, newest first."""

    movies: list[OwnedMovie]


async def listing_owner(
    request: Request, response: Response, context: Here, owner: RequiredOwner
) -> Owner:
    """Return the owner, count the request towards the limit on lists, and forbid caching."""
    response.headers["Cache-Control"] = "no-store"
    context.take_list(request)
    return owner


ListingOwner = Annotated[Owner, Depends(listing_owner)]


@router.get("/folds", summary="List my folds", responses=problems(401, 422, 429))
def get_my_folds(
    context: Here,
    owner: ListingOwner,
    before: Annotated[
        str | None,
        Query(
            pattern=CURSOR_PATTERN,
            description="Value of `before` in the link `next` of the previous page of the list.",
        ),
    ] = None,
    limit: Annotated[int, Query(ge=1, le=100, description=("Maximum number of results."))] = 24,
) -> OwnedFolds:
    """List the folds that were first requested with this token, including gallery shapes."""
    owned = folds_made(context.store, owner, before=before, limit=limit)
    query = urlencode({"before": owned.next, "limit": limit}, safe=",")
    return OwnedFolds(
        folds=[Fold.of(row, context.store, context.remaining) for row in owned.rows],
        next=f"{router.prefix}/folds?{query}" if owned.next else None,
        total=owned.total,
    )


@router.get("/previews", summary="List my previews", responses=problems(401, 429))
def get_my_previews(context: Here, owner: ListingOwner) -> OwnedPreviews:
    """List the previews of files sent with this token, each with its latest options."""
    keep_s = context.settings.preview_keep_s
    return OwnedPreviews(
        previews=[
            OwnedPreview(
                id=row.id,
                title=shown_name(row.name) or "New shape",
                module=row.module,
                module_words=ModuleWordsBody.of(words_named(row.module, row.module_words)),
                modules=row.modules,
                created_at=moment(row.created_at),
                expires_at=moment(row.seen_at + keep_s),
                page=f"/previews/{row.id}{'?' if row.query else ''}{row.query}",
                drawing=f"/previews/{row.id}/drawing.svg?key={row.key}",
            )
            for row in context.previews.owned(owner)
        ]
    )


@router.delete(
    "/previews/{preview_id}",
    status_code=204,
    summary="Delete a preview",
    responses=problems(401, 403, 429),
)
def delete_my_preview(context: Here, owner: ListingOwner, preview_id: str) -> Response:
    """Delete an upload and its previews. Its folds are not deleted."""
    if not context.previews.remove(preview_id, owner):
        raise not_owner("This is not the token of the preview's owner.")
    return Response(status_code=204)


@router.get("/movies", summary="List my movies", responses=problems(401, 429))
def get_my_movies(context: Here, owner: ListingOwner) -> OwnedMovies:
    """List the movies that were requested with this token, newest first."""
    return OwnedMovies(
        movies=[
            OwnedMovie(
                title=ShownFold.of(fold).title,
                created_at=moment(row.created_at),
                movie=MovieBody.of(row),
            )
            for row, fold in context.movies.made(owner)
        ]
    )


@router.post(
    "/key",
    summary="Replace a token that other people may know",
    responses=problems(400, 401, 422, 429),
    openapi_extra=described(KeyRequest),
)
def post_my_key(
    context: Here, owner: ListingOwner, wanted_key: Annotated[KeyRequest, json_body(KeyRequest)]
) -> KeyReplaced:
    """Move everything that belongs to this token to another token. This token stops working."""
    token = wanted_key.owner_token
    claim = Claim.new() if token is None else Claim(token)
    if claim.owner == owner:
        raise Malformed(
            "same-key",
            "got the current token, expected a new one; send another token, or none to let the "
            "service create one.",
        )
    folds = hand_over_all(context.store, owner, claim.owner)
    return KeyReplaced(owner_token=claim.token, folds=folds)
