"""Routes of folds: request, watch, download, cancel, delete."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import asdict, replace
from io import BytesIO
from typing import Annotated, Any, BinaryIO, Final

from fastapi import APIRouter, Depends, File, Form, Request, UploadFile
from fastapi.responses import Response
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from fastapi.sse import EventSourceResponse, ServerSentEvent

from planner.errors import InputError
from planner.names import clean_name
from planner.pathfinding.options import PathOptions
from planner.pipeline.request import FoldRequest, PreviewRequest
from planner.readers.limits import quote
from server.api.base_folds import beginning_noted, beginning_of
from server.api.context import Context, context_of, in_list_rate
from server.api.forms import form_of
from server.api.schemas import (
    MAX_FOLD_NAME,
    Accepted,
    Fold,
    FoldChanges,
    Folds,
    Links,
    ProblemBody,
    Shape,
    Shapes,
)
from server.api.submit import Submission, input_noted, noted, submit
from server.errors import Forbidden, Unidentified, Unusable
from server.files.cancelled import sweep_cancelled_of
from server.http.client_address import address_of
from server.http.response_cache import mark
from server.store.folds import new_token
from server.store.owned import change_fold

router = APIRouter(prefix="/api/folds", tags=["folds"])
OPTIONAL_ID: Final = "^[A-Za-z0-9_-]*$"
MESH_SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".3mf")
"""File name suffixes of uploads that are triangle meshes, in lower case. Other uploads hold voxels,
paths of cells, or chains."""
bearer = HTTPBearer(auto_error=False, description="The owner token of a fold.")

Here = Annotated[Context, Depends(context_of)]
Bearer = Annotated[HTTPAuthorizationCredentials | None, Depends(bearer)]


Uploaded = Annotated[UploadFile | None, File(description="A mesh, voxels, a path or a chain.")]
GalleryShape = Annotated[str | None, Form(description="Or: the name of a gallery shape.")]


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the problems that a route may answer with, as OpenAPI describes them."""
    content = {"application/problem+json": {"schema": ProblemBody.model_json_schema()}}
    return {status: {"description": "A problem", "content": content} for status in statuses}


@router.post(
    "",
    status_code=202,
    summary="Fold an upload or a gallery shape",
    responses=problems(404, 409, 413, 422, 429, 503, 507),
)
def post_fold(
    *,
    request: Request,
    context: Here,
    credentials: Bearer,
    asked: Annotated[FoldRequest, Depends(form_of(FoldRequest))],
    file: Uploaded = None,
    shape: GalleryShape = None,
    preview: Annotated[
        str | None, Form(max_length=64, pattern=OPTIONAL_ID, description="Or: the id of a preview.")
    ] = None,
    fold: Annotated[
        str | None,
        Form(
            max_length=64,
            pattern=OPTIONAL_ID,
            description="Or: the id of a fold whose input and shape options are used again.",
        ),
    ] = None,
    refold: Annotated[
        str | None,
        Form(
            max_length=64,
            pattern=OPTIONAL_ID,
            description="The id of a finished fold. Its chain unfolds and then folds into the "
            "shape, which must have the same number of modules of the same kind.",
        ),
    ] = None,
    smooth: Annotated[
        str | None,
        Form(
            max_length=64,
            pattern=OPTIONAL_ID,
            description="Or: the id of a verified fold. A new fold makes its motion shorter and "
            "smoother. Preset and strategy do not apply, because there is no new explosion.",
        ),
    ] = None,
) -> Accepted:
    """Accept a fold and add it to the queue.

    The same request with the same token returns the same fold. A gallery shape with default
    options is folded once for everyone.
    """
    asked = replace(asked, refold=refold is not None, smooth=smooth is not None)
    validate(asked)
    if shape is not None and asked.world == "table":
        asked = replace(asked, as_voxels=True)  # likewise those of the gallery
    source, filename = input_of(context, file, shape, preview, fold, smooth)
    if smooth is not None and refold is not None:
        source.close()
        raise Unusable(
            "smooth-or-refold", "got the form fields 'smooth' and 'refold', expected one."
        )
    with source:
        previewed = PreviewRequest(**asdict(asked.path_options()), seed=asked.seed)
        cells = _previewed(context, preview, previewed)
        prepared = None if preview is None else context.previews.prepared(preview, previewed)
        again = smooth if fold is None else fold
        row = None
        if again is not None:
            row = context.store.fold(again)
            shape = row.shape
            path, cells = noted(context.store.directory(again))
            if asked.world != row.world and asked.world == "table":
                # The path of a floating chain is not used; a mesh gets 2×2×2 modules as before.
                mesh = cells is None or (filename or "").lower().endswith(MESH_SUFFIXES)
                method = "blocks" if mesh and path.method == "auto" else "auto"
                path = replace(path, as_voxels=True, method=method)
            # The world is asked for each time.
            asked = replace(asked, **{**asdict(path), "world": asked.world})
            validate(asked)
            if smooth is not None and asked.module_size is None:
                asked = replace(asked, module_size=row.module_size)
        beginning = None
        if smooth is not None:
            beginning = beginning_of(context, smooth, "smooth")
        elif refold is not None:
            beginning = beginning_of(context, refold, "refold")
            if file is not None or preview is not None:  # others know what they are made of
                modules = asked.modules or beginning.modules
                asked = replace(asked, module=beginning.module, modules=modules)
        elif fold is not None and row is not None:
            beginning = beginning_noted(context.store.directory(fold), row)
        with context.uploads.stored(source, filename) as upload:
            receipt = submit(
                context,
                Submission(
                    upload=upload,
                    shape=shape,
                    request=asked.canonical(),
                    visitor=context.visitor(request),
                    token=token_of(credentials) or new_token(),
                    cells=cells,
                    prepared=prepared,
                    beginning=beginning,
                    again=None if fold is None else row,
                ),
            )
    return Accepted(
        id=receipt.row.id,
        owner_token=receipt.token,
        existing=receipt.existing,
        links=Links.of(receipt.row.id),
    )


@router.get(
    "",
    summary="List gallery folds and your own folds",
    dependencies=[Depends(in_list_rate)],
    responses=problems(429),
)
def get_folds(context: Here, credentials: Bearer) -> Folds:
    """List gallery folds and your own folds. Folds of other owners are never listed."""
    rows = {row.id: row for row in context.store.list_public()}
    if (token := token_of(credentials)) is not None:
        rows.update({row.id: row for row in context.store.list_owned(token)})
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
    """Send server-sent events until the fold is over."""
    response.headers["Cache-Control"] = "no-store"
    async for event in context.fold_states.events(fold_id):
        yield event


@router.get(
    "/{fold_id}/refolds",
    summary="List gallery shapes that a fold can be refolded into",
    responses=problems(404),
)
def get_refolds(fold_id: str, context: Here) -> Shapes:
    """List shapes with the same number of modules of the same kind, except the fold's own."""
    row = context.store.fold(fold_id)
    fitting = context.gallery.fitting(row.module, row.modules)
    return Shapes(shapes=[Shape.of(shape) for shape in fitting if shape.name != row.shape])


@router.post(
    "/{fold_id}/cancel", status_code=202, summary="Stop a fold", responses=problems(401, 403, 404)
)
def post_cancel(fold_id: str, context: Here, credentials: Bearer) -> Fold:
    """Cancel a fold. A gallery fold that other clients requested too keeps running.

    The input is stored for up to an hour, so that the fold can be started again.
    """
    store = context.store
    before = store.fold(fold_id)
    if not store.cancel(fold_id, needed(credentials)):
        raise _not_owner()
    row = store.fold(fold_id)
    if not before.over:
        context.jobs.forget(fold_id)
        sweep_cancelled_of(store, row.visitor)
    return Fold.of(row, context.store, context.remaining)


@router.patch(
    "/{fold_id}",
    summary=("Rename a fold or change its owner token"),
    responses=problems(401, 403, 404, 422),
)
def patch_fold(fold_id: str, changes: FoldChanges, context: Here, credentials: Bearer) -> Fold:
    """Change the name on pages, in lists and of downloads; the name inside the plan stays.

    Gallery folds cannot be renamed.
    """
    store = context.store
    row, token = store.fold(fold_id), needed(credentials)
    if row.public:
        raise Forbidden(
            "public", "This is a gallery fold, which everyone can see; it cannot be renamed."
        )
    name = None if changes.name is None else clean_name(changes.name, max_length=MAX_FOLD_NAME)
    if name == "":
        raise Unusable(
            "empty-name",
            f"got a name without printable characters, expected 1 to {MAX_FOLD_NAME} characters.",
            where="name",
        )
    if not change_fold(store, fold_id, token, name=name, new_token=changes.owner_token):
        raise _not_owner()
    return Fold.of(store.fold(fold_id), store, context.remaining)


@router.delete(
    "/{fold_id}", status_code=204, summary="Delete a fold", responses=problems(401, 403, 404)
)
def delete_fold(fold_id: str, context: Here, credentials: Bearer) -> Response:
    """Delete a fold permanently. Gallery folds cannot be deleted."""
    store = context.store
    row, token = store.fold(fold_id), needed(credentials)
    if row.public:
        raise Forbidden(
            "public", "This is a gallery fold, which everyone can see; it cannot be deleted."
        )
    if not store.delete(fold_id, token):
        raise _not_owner()
    context.jobs.forget(fold_id)
    store.folders.remove(fold_id)
    return Response(status_code=204)


def validate(request: PathOptions) -> None:
    """Refuse an invalid request with the planner's error.

    Raises:
        Unusable: When it is so.
    """
    try:
        request.check()
    except InputError as error:
        raise Unusable.of(error) from None


def input_of(
    context: Context,
    file: UploadFile | None,
    shape: str | None,
    preview: str | None,
    fold: str | None = None,
    smooth: str | None = None,
) -> tuple[BinaryIO, str | None]:
    """Return the open input of a form and its name: a file, or one that the service has.

    Raises:
        NoSuchFoldError: When there is no such fold.
        NoSuchPreviewError: When the preview is not there any more.
        ServiceError: When it is none of them, or several.
    """
    given = [
        name
        for name, value in (
            ("file", file),
            ("shape", shape),
            ("preview", preview),
            ("fold", fold),
            ("smooth", smooth),
        )
        if value is not None
    ]
    if len(given) != 1:
        raise Unusable(
            "file-or-shape",
            f"got {' and '.join(given) or 'none'} of the form fields 'file', 'shape', "
            "'preview', 'fold' and 'smooth', expected one of them.",
        )
    if file is not None:
        return file.file, clean_filename(file.filename)
    if preview is not None:
        return context.previews.upload(preview)
    if (again := smooth if fold is None else fold) is not None:
        context.store.fold(again)
        return input_noted(context.store.directory(again))
    found = context.gallery.shape(shape or "")
    if found is None:
        raise Unusable(
            "no-such-shape",
            f"got the shape {quote(shape)!r}, expected one of "
            f"{context.gallery.nearest((shape or '')[:100])}; GET /api/shapes lists them.",
        )
    return BytesIO(found.data), found.filename


def _previewed(
    context: Context, preview: str | None, options: PreviewRequest
) -> list[list[int]] | None:
    """Return the cells that a preview has found, so that the fold's page can draw them at once."""
    return None if preview is None else context.previews.cells(preview, options)


def clean_filename(name: str | None) -> str | None:
    """Return the last part of an upload's file name, fit to be shown; None if nothing is left."""
    last = (name or "").replace("\\", "/").rpartition("/")[2]
    return clean_name(last, max_length=MAX_FOLD_NAME) or None


def token_of(credentials: HTTPAuthorizationCredentials | None) -> str | None:
    """Return the token, or None; a short one could be guessed and counts as none."""
    if credentials is None or not 24 <= len(credentials.credentials) <= 200:
        return None
    return credentials.credentials


def needed(credentials: HTTPAuthorizationCredentials | None) -> str:
    """Return the token.

    Raises:
        Unidentified: When there is none.
    """
    if (token := token_of(credentials)) is not None:
        return token
    raise Unidentified(
        "no-owner-token",
        "This needs the fold's owner token, which the answer to the upload contained, as "
        "'Authorization: Bearer …'.",
    )


def _not_owner() -> Forbidden:
    return Forbidden(
        "not-owner",
        "This is not the token of the fold's owner. A gallery fold that several clients requested "
        "has no owner.",
    )
