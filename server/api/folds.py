"""Routes of folds: request, watch, download, cancel, delete."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import asdict, replace
from io import BytesIO
from typing import Annotated, Any, BinaryIO, Final, Literal

from fastapi import APIRouter, Depends, File, Form, Request, UploadFile
from fastapi.responses import Response
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from fastapi.sse import EventSourceResponse, ServerSentEvent

from planner.errors import InputError
from planner.names import clean_name
from planner.parameters.setting import Setting
from planner.parameters.settings import MAX_TEXT_CHARS, SETTINGS, TABLE_SETTINGS
from planner.pathfinding.options import MODULE_COUNTS
from planner.pathfinding.starts import TEXT as START
from planner.pathfinding.starts import cell_of
from planner.pipeline.request import MAX_SEED, MODULE_SIZE_RANGE
from planner.pipeline.request import Request as Asked
from planner.readers.limits import quote
from server.api.base_folds import beginning_noted, beginning_of
from server.api.context import Context, context_of, in_list_rate
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
from server.files.previews import ShapeOptions
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


def listed(settings: tuple[Setting, ...]) -> str:
    """Names of settings with their units or words, for OpenAPI."""
    told = {s.name: s.unit or " or ".join(s.words) for s in settings}
    return ", ".join(f"`{name}`{f' ({what})' if what else ''}" for name, what in told.items())


def _options(
    module: Annotated[
        Literal["cube", "tetrahedron"],
        Form(description="Module type for meshes, voxels and cells. A chain file states its own."),
    ] = "cube",
    modules: Annotated[
        int | None,
        Form(
            ge=MODULE_COUNTS[0],
            le=MODULE_COUNTS[1],
            description="Approximate number of modules. Default for meshes: 160.",
        ),
    ] = None,
    method: Annotated[
        Literal["auto", "blocks", "exact", "snake"],
        Form(description="Path method. `blocks` splits each voxel into 2×2×2 modules."),
    ] = "auto",
    repair: Annotated[
        bool, Form(description="Add or remove cells if the shape has no path.")
    ] = False,
    ends: Annotated[
        Literal["any", "surface"],
        Form(description=("`surface` puts both ends of the chain on the outside.")),
    ] = "any",
    as_voxels: Annotated[
        bool, Form(description="Read a list of cells as a shape, not as a path.")
    ] = False,
    start: Annotated[
        str | None,
        Form(
            pattern=rf"^{START}$",
            description="The cell where the chain starts: `x,y,z`, one of the preview's `cells`.",
        ),
    ] = None,
    world: Annotated[
        Literal["floating", "table"],
        Form(
            description="World: `floating` has no gravity; on a `table` the chain is always "
            "supported and needs as little torque as possible. Settings on a table: "
            f"{listed(TABLE_SETTINGS)}."
        ),
    ] = "floating",
) -> ShapeOptions:
    return ShapeOptions(
        module=module,
        modules=modules,
        method=method,
        repair=repair,
        ends=ends,
        as_voxels=as_voxels,
        start=cell_of(start) if start else None,
        world=world,
    )


PathOptions = Annotated[ShapeOptions, Depends(_options)]
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
    options: PathOptions,
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
    preset: Annotated[
        Literal["default", "paper", "direct"],
        Form(
            description=(
                "`direct` is direct servoing: it drives every joint straight to its target (fails "
                "for most shapes)."
            )
        ),
    ] = "default",
    settings: Annotated[
        str,
        Form(
            # Longer ones are refused in the planner's words.
            json_schema_extra={"maxLength": MAX_TEXT_CHARS},
            description="Other values for the presets `paper` and `direct`, for example "
            f"`damping=0.05,radial_gain=0.2`. Available settings: {listed(SETTINGS)}.",
        ),
    ] = "",
    seed: Annotated[int, Form(ge=0, le=MAX_SEED)] = 0,
    module_size: Annotated[
        float | None,
        Form(
            ge=MODULE_SIZE_RANGE[0],
            le=MODULE_SIZE_RANGE[1],
            description=(
                "Edge of a module in pitches (one pitch is the distance between modules)."
            ),
        ),
    ] = None,
    strategy: Annotated[
        Literal["auto", "simultaneous", "blocks", "peel", "one-by-one"],
        Form(
            description="How the chain is released: all at once, rigid blocks first, or one part "
            "at a time from its far end, which `auto` uses for long chains. `one-by-one`, a "
            "baseline, bends one joint at a time."
        ),
    ] = "auto",
    prefer: Annotated[
        Literal["computing", "time", "torque", "clearance"],
        Form(
            description="Preferred plan. `computing` is the first verified plan. The others choose "
            "from several verified plans: `time` by folding time at the joints' speed limit, "
            "`torque` by torque at equal folding time, `clearance` by proved clearance. They try "
            "other strategies, paths and smoothings, which takes several times as long. The plan's "
            "`attempts` list all of them with their figures."
        ),
    ] = "computing",
) -> Accepted:
    """Accept a fold and add it to the queue.

    The same request with the same token returns the same fold. A gallery shape with default
    options is folded once for everyone.
    """
    asked = Asked(
        preset=preset,
        settings=settings,
        strategy=strategy,
        prefer=prefer,
        world=options.world,  # pyright: ignore[reportArgumentType]
        refold=refold is not None,
        smooth=smooth is not None,
    )
    checked(asked, options)
    if shape is not None and options.world == "table":
        options = replace(options, as_voxels=True)  # likewise those of the gallery
    source, filename = input_of(context, file, shape, preview, fold, smooth)
    if smooth is not None and refold is not None:
        source.close()
        raise Unusable(
            "smooth-or-refold", "got the form fields 'smooth' and 'refold', expected one."
        )
    with source:
        previewed = replace(options, seed=seed)
        cells = _previewed(context, preview, previewed)
        prepared = None if preview is None else context.previews.prepared(preview, previewed)
        again = smooth if fold is None else fold
        row = None
        if again is not None:
            row = context.store.fold(again)
            shape = row.shape
            world, (options, cells) = options.world, noted(context.store.directory(again))
            if world != row.world and world == "table":
                # The path of a floating chain is not used; a mesh gets 2×2×2 modules as before.
                mesh = cells is None or (filename or "").lower().endswith(MESH_SUFFIXES)
                method = "blocks" if mesh and options.method == "auto" else "auto"
                options = replace(options, as_voxels=True, method=method)
            options = replace(options, world=world)  # which is asked for each time
            checked(asked, options)
            if smooth is not None and module_size is None:
                module_size = row.module_size
        beginning = None
        if smooth is not None:
            beginning = beginning_of(context, smooth, "smooth")
        elif refold is not None:
            beginning = beginning_of(context, refold, "refold")
            if file is not None or preview is not None:  # others know what they are made of
                modules = options.modules or beginning.modules
                options = replace(options, module=beginning.module, modules=modules)
        elif fold is not None and row is not None:
            beginning = beginning_noted(context.store.directory(fold), row)
        with context.uploads.stored(source, filename) as upload:
            receipt = submit(
                context,
                Submission(
                    upload=upload,
                    shape=shape,
                    preset=preset,
                    settings=asked.canonical().settings,
                    seed=seed,
                    module_size=module_size,
                    visitor=context.visitor(request),
                    token=token_of(credentials) or new_token(),
                    options=options,
                    cells=cells,
                    prepared=prepared,
                    beginning=beginning,
                    strategy=strategy,
                    prefer=prefer,
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
    store.folders.remove(fold_id)
    return Response(status_code=204)


def checked(asked: Asked, options: ShapeOptions) -> None:
    """Refuse an invalid request with the planner's error.

    Raises:
        Unusable: When it is so.
    """
    wished = {k: v for k, v in asdict(options).items() if k not in ("path", "seed")}
    try:
        replace(asked, **wished).check()
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
    context: Context, preview: str | None, options: ShapeOptions
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
