"""Routes of module values: an owner's numbers for the modules of a fold, shown as colours."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends
from fastapi.responses import JSONResponse, Response
from pydantic import ConfigDict

from foldback.planner.plan.module_values import checked_values
from foldback.server.context import Here
from foldback.server.dependencies.described_answers import problems
from foldback.server.dependencies.owner_tokens import RequiredOwner, not_owner
from foldback.server.dependencies.request_bodies import described, json_body
from foldback.server.dependencies.requested_folds import (
    NOT_FOLD_OWNER,
    NOTHING_STORED,
    ExistingFold,
    check_private,
    frames_of_own,
)
from foldback.server.errors import NotFound
from foldback.server.schemas import Body
from foldback.server.store.folds import NoSuchFoldError
from foldback.server.store.owned_items import write_beside
from foldback.server.store.schema import ValuesRow
from foldback.server.viewing.fold_notes import values_of

router = APIRouter(prefix="/api/folds/{fold_id}/values", tags=["values"])


class ValuesBody(Body):
    """Numbers for modules in the format `foldback-values/1`."""

    model_config = ConfigDict(extra="forbid")

    format: str
    """`foldback-values/1`"""
    name: str
    """Name of the quantity; at most 80 characters."""
    unit: str
    """Unit of the numbers; at most 20 characters."""
    low: float
    """Smallest number."""
    high: float
    """Largest number."""
    rows: int
    """Number of rows; the rows are spread evenly over the frames."""
    data: str
    """Base64 of a byte for each module of each row: 0 to 254 from `low` to `high`, 255 for none."""


@router.get(
    "",
    summary="Get the numbers stored with a fold",
    responses={200: {"model": ValuesBody}, **problems(404)},
)
def get_values(fold_id: str, context: Here) -> JSONResponse:
    """Return the numbers that colour the modules; 404 if the owner has stored none."""
    located = context.store.find(fold_id)
    if located is None:
        raise NoSuchFoldError(fold_id)
    values = values_of(context.store, located)
    if values is None:
        raise NotFound("no-values", "No numbers are stored with this fold.")
    return JSONResponse(values, headers={"Cache-Control": "private, no-cache"})


@router.put(
    "",
    summary="Store numbers with a fold",
    responses=problems(401, 403, 404, 409, 413, 422),
    dependencies=[Depends(frames_of_own)],
    openapi_extra=described(ValuesBody),
)
def put_values(
    fold: ExistingFold,
    context: Here,
    owner: RequiredOwner,
    body: Annotated[dict[str, Any], json_body(dict)],
) -> ValuesBody:
    """Store numbers that colour the modules.

    Send one number per module for the whole fold, or one per module for each of several frames.
    """
    checked = checked_values(body, fold.modules)
    if not write_beside(context.store, fold.id, owner, ValuesRow, checked):
        raise not_owner(NOT_FOLD_OWNER)
    return ValuesBody.model_validate(checked)


@router.delete(
    "",
    status_code=204,
    summary="Delete the numbers stored with a fold",
    responses=problems(401, 403, 404),
)
def delete_values(fold: ExistingFold, context: Here, owner: RequiredOwner) -> Response:
    """Delete the stored numbers."""
    check_private(fold, NOTHING_STORED)
    if not write_beside(context.store, fold.id, owner, ValuesRow, None):
        raise not_owner(NOT_FOLD_OWNER)
    return Response(status_code=204)
