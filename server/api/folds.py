"""Routes of folds: request, watch, download, cancel, delete."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Annotated

import msgspec
from fastapi import APIRouter, Depends, Request
from fastapi.responses import Response
from fastapi.sse import EventSourceResponse, ServerSentEvent
from msgspec import Meta

from foldback.planner.chain.display_names import clean_name
from foldback.planner.pipeline.request import FoldRequest
from foldback.server.context import Here, in_list_rate
from foldback.server.dependencies.described_answers import problems
from foldback.server.dependencies.owner_tokens import (
    AnyClaim,
    NewToken,
    OptionalOwner,
    RequiredOwner,
    not_owner,
)
from foldback.server.dependencies.request_bodies import described, form_of, json_body
from foldback.server.dependencies.requested_folds import (
    NOT_FOLD_OWNER,
    ExistingFold,
    OwnedFold,
    check_private,
)
from foldback.server.errors import Unusable
from foldback.server.http.client_address import address_of
from foldback.server.http.response_cache import mark
from foldback.server.jobs.housekeeping import limit_cancelled
from foldback.server.schemas import (
    MAX_FOLD_NAME,
    Accepted,
    Fold,
    Folds,
    Links,
    Shape,
    Shapes,
)
from foldback.server.store.owned_items import change_fold
from foldback.server.store.owner import Owner
from foldback.server.submission.fold_inputs import Origin
from foldback.server.submission.submit import fold_origin

router = APIRouter(prefix="/api/folds", tags=["folds"])


class FoldChanges(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Changes to a fold; omitted fields stay as they are."""

    name: Annotated[
        Annotated[str, Meta(max_length=MAX_FOLD_NAME)] | None,
        Meta(description="New name. Characters that cannot be printed are removed."),
    ] = None
    owner_token: Annotated[NewToken | None, Meta(description="New owner token.")] = None


@router.post(
    "",
    status_code=202,
    summary="Fold an upload or a gallery shape",
    responses=problems(404, 409, 413, 422, 429, 503, 507),
)
def post_fold(
    http: Request,
    context: Here,
    claim: AnyClaim,
    origin: Annotated[Origin, Depends(Origin)],
    fold_request: Annotated[FoldRequest, Depends(form_of(FoldRequest))],
) -> Accepted:
    """Accept a fold and add it to the queue.

    The same request with the same token returns the same fold. A gallery shape with default
    options is folded once for everyone.
    """
    request = replace(
        fold_request, refold=origin.refold is not None, smooth=origin.smooth is not None
    )
    request.check()
    receipt = fold_origin(
        context, origin, request, visitor=context.visitor(http), owner=claim.owner
    )
    return Accepted(
        id=receipt.row.id,
        owner_token=claim.token if receipt.is_own else None,
        existing=receipt.existing,
        links=Links.of(receipt.row.id),
    )


@router.get(
    "",
    summary="List gallery folds and your own folds",
    dependencies=[Depends(in_list_rate)],
    responses=problems(429),
)
def get_folds(context: Here, owner: OptionalOwner) -> Folds:
    """List gallery folds and your own folds. Folds of other owners are never listed."""
    rows = {row.id: row for row in context.store.list_public()}
    if owner is not None:
        rows.update({row.id: row for row in context.store.list_owned(owner)})
    newest_first = sorted(rows.values(), key=lambda row: row.created_at, reverse=True)
    return Folds(folds=[Fold.of(row, context.store, context.remaining) for row in newest_first])


@router.get("/{fold_id}", summary="Get the state of a fold", responses=problems(404))
def get_fold(request: Request, fold_id: str, context: Here) -> Fold:
    """Return the current state of a fold."""
    row = context.store.fold(fold_id)
    context.store.looked(row)
    mark(request, row)
    return Fold.of(row, context.store, context.remaining)


async def follower(request: Request, fold_id: str, context: Here) -> AsyncIterator[None]:
    """Hold a place among a fold's event streams for as long as the answer lasts."""
    await context.fold_states.state(fold_id)
    with context.streams.enter(address_of(request)):
        yield


@router.get(
    "/{fold_id}/events",
    summary="Follow a fold",
    dependencies=[Depends(follower)],
    response_class=EventSourceResponse,
    response_description="Server-sent events: `progress` for each change, `done` at the end.",
    responses=problems(404, 429),
)
async def get_events(
    fold_id: str, context: Here, response: Response
) -> AsyncIterator[ServerSentEvent]:
    """Stream server-sent events until the fold ends."""
    response.headers["Cache-Control"] = "no-store"
    async for event in context.fold_states.events(fold_id):
        yield event


@router.get(
    "/{fold_id}/refolds",
    summary="List gallery shapes that a fold can be refolded into",
    responses=problems(404),
)
def get_refolds(fold_id: str, context: Here) -> Shapes:
    """List gallery shapes with as many modules of the same kind, except the fold's own shape."""
    row = context.store.fold(fold_id)
    fitting = context.gallery.fitting(row.module, row.modules)
    return Shapes(shapes=[Shape.of(shape) for shape in fitting if shape.name != row.shape])


@router.post(
    "/{fold_id}/cancel", status_code=202, summary="Stop a fold", responses=problems(401, 403, 404)
)
def post_cancel(before: ExistingFold, context: Here, owner: RequiredOwner) -> Fold:
    """Cancel a fold. A gallery fold keeps running if other clients requested it, too.

    The input is stored for up to an hour, so that the fold can be started again.
    """
    store, fold_id = context.store, before.id
    if not store.cancel(fold_id, owner):
        raise not_owner(NOT_FOLD_OWNER)
    row = store.fold(fold_id)
    if not before.over:
        limit_cancelled(store, row.visitor)
    return Fold.of(row, context.store, context.remaining)


@router.patch(
    "/{fold_id}",
    summary=("Rename a fold or change its owner token"),
    responses=problems(401, 403, 404, 422),
    openapi_extra=described(FoldChanges),
)
def patch_fold(
    row: OwnedFold,
    changes: Annotated[FoldChanges, json_body(FoldChanges)],
    context: Here,
    owner: RequiredOwner,
) -> Fold:
    """Change the name or the owner token of a fold.

    The name is shown on pages, in lists and in download file names; the name in the plan stays the
    same.

    Gallery folds cannot be renamed.
    """
    store = context.store
    name = None if changes.name is None else clean_name(changes.name, max_length=MAX_FOLD_NAME)
    if name == "":
        raise Unusable(
            "empty-name",
            "got a name without printable characters, expected 1 to {max_chars} characters.",
            where="name",
            max_chars=MAX_FOLD_NAME,
        )
    heir = None if changes.owner_token is None else Owner.from_token(changes.owner_token)
    if not change_fold(store, row.id, owner, name=name, heir=heir):
        raise not_owner(NOT_FOLD_OWNER)
    return Fold.of(store.fold(row.id), store, context.remaining)


@router.delete(
    "/{fold_id}", status_code=204, summary="Delete a fold", responses=problems(401, 403, 404)
)
def delete_fold(row: ExistingFold, context: Here, owner: RequiredOwner) -> Response:
    """Delete a fold permanently. Gallery folds cannot be deleted."""
    check_private(row, "it cannot be deleted")
    if not context.store.delete(row.id, owner):
        raise not_owner(NOT_FOLD_OWNER)
    context.store.folders.remove(row.id)
    return Response(status_code=204)
