"""Routes of shapes: the gallery, and previews before folding."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import AsyncGenerator, Mapping
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Annotated, Any
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Form, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import Response

from foldback.planner.chain.module_file import module_schema
from foldback.planner.parameters.option import options_of
from foldback.planner.pipeline.request import FoldRequest, PreviewRequest
from foldback.server.context import Context, Here
from foldback.server.dependencies.described_answers import problems
from foldback.server.dependencies.owner_tokens import OptionalOwner
from foldback.server.dependencies.request_bodies import field, form_of
from foldback.server.errors import NotFound, Unusable
from foldback.server.files.preview_reports import Asker
from foldback.server.schemas import (
    MAX_FOLD_NAME,
    Preview,
    Shape,
    Shapes,
    TableOffers,
    expected_times,
)
from foldback.server.submission.fold_inputs import (
    GalleryShape,
    Origin,
    Uploaded,
    check_readable,
    id_field,
    open_input,
)

router = APIRouter(prefix="/api/shapes", tags=["shapes"])
Options = Annotated[PreviewRequest, Depends(form_of(PreviewRequest))]
Seed = Annotated[int, field(options_of(FoldRequest)["seed"])]


@router.get("", summary="List the gallery shapes")
def get_shapes(context: Here) -> Shapes:
    """List the example shapes that `POST /api/folds` accepts by name."""
    return Shapes(shapes=[Shape.of(shape) for shape in context.gallery.shapes()])


async def previewed_in_form(
    file: Uploaded = None,
    shape: GalleryShape = None,
    preview: Annotated[
        str | None,
        id_field(
            "Instead of a file or a gallery shape: the id of an earlier preview. Its shape is "
            "previewed with these options."
        ),
    ] = None,
    fold: Annotated[
        str | None,
        id_field(
            "Instead of a file: the id of a fold whose input is previewed with these options. "
            "Except for gallery shapes, this needs the owner token of the fold."
        ),
    ] = None,
) -> Origin:
    """Return the origin of a preview that a form names."""
    return Origin(file=file, shape=shape, preview=preview, fold=fold)


async def preview_in_form(
    options: Options,
    seed: Seed = 0,
    path: Annotated[
        bool,
        Form(
            description="Search for a path. Without a search, the response for voxels and meshes "
            "comes sooner, but contains only their cells."
        ),
    ] = True,
    full: Annotated[bool, Form(description="Include cells and mesh, which may be large.")] = True,
    quick: Annotated[
        bool,
        Form(
            description="Accept a first result. For most meshes it comes sooner, with `final` "
            "false in the response. A fold uses the final result."
        ),
    ] = False,
) -> tuple[PreviewRequest, bool]:
    """Return the request of a preview, and True if the answer includes what may be large."""
    return replace(options, seed=seed, path=path, quick=quick), full


@router.post(
    "/preview",
    summary="Preview a shape before folding it",
    responses=problems(404, 413, 422, 429, 503, 504, 507),
)
async def post_preview(
    request: Request,
    context: Here,
    owner: OptionalOwner,
    origin: Annotated[Origin, Depends(previewed_in_form)],
    form: Annotated[tuple[PreviewRequest, bool], Depends(preview_in_form)],
) -> Preview:
    """Return the voxels and a path through them, if there is one.

    `POST /api/folds` takes the preview's id. With a token, the preview is listed in
    `GET /api/mine/previews`.
    """
    options, full = form
    bounded(options, context.settings.max_modules)

    def reported(asker: Asker) -> Preview:
        preview = origin.preview
        if preview is None or origin != Origin(preview=preview):
            if origin.fold is not None:
                check_readable(context.store.fold(origin.fold), owner)
            with (
                open_input(context, origin) as (stream, filename),
                context.uploads.stored(stream, filename) as upload,
            ):
                preview = context.preview_reports.add(upload, asker.visitor, owner)
        report = context.preview_reports.report(preview, options, asker)
        answered = options.complete if report.get("final", True) else options
        if owner is not None:
            context.previews.note_view(preview, owner, viewed(answered, report))
        times = expected_times(report, options.world, context.estimates.total_s)
        max_modules = context.settings.max_modules
        reach = [
            {**row, "modules": None} if (row["modules"] or 0) > max_modules else row
            for row in report.get("reach", [])
        ]
        report = {**report, "reach": reach}
        return Preview.of(preview, answered.key, report, times, full=full)

    async with asking(request, context) as asker:
        return await run_in_threadpool(reported, asker)


@router.post(
    "/offers",
    summary="Find versions of a previewed shape that can fold on a table",
    responses=problems(404, 422, 429, 503, 504, 507),
)
async def post_offers(
    request: Request,
    context: Here,
    options: Options,
    preview: Annotated[str, id_field("The id of an earlier preview.")],
    seed: Seed = 0,
) -> TableOffers:
    """Search for similar shapes: repaired, doubled, or with another number of modules.

    A doubled shape has 2×2×2 modules for each voxel. Send the options of the preview that found
    no path on a table. The search may take as long as a preview, and the service's limits count it
    as a preview. The search ends if the client disconnects.
    """
    options = replace(options, seed=seed)
    bounded(options, context.settings.max_modules)
    async with asking(request, context) as asker:
        offers = await run_in_threadpool(context.preview_reports.offers, preview, options, asker)
    return TableOffers.model_validate(offers)


def bounded(options: PreviewRequest, max_modules: int) -> None:
    """Refuse options that are invalid or ask for too many modules.

    Raises:
        Unusable: If there are too many modules (``too-many-modules``).
        InputError: If an option is invalid.
    """
    if options.modules is not None and options.modules > max_modules:
        raise Unusable(
            "too-many-modules",
            "got {count} modules, expected at most {limit}.",
            count=options.modules,
            limit=max_modules,
        )
    options.check()


def viewed(options: PreviewRequest, report: dict[str, Any]) -> dict[str, Any]:
    """Return what an owner's list says of a preview with these options."""
    values = {**options.complete.changed(), **({"seed": options.seed} if options.seed else {})}
    return {
        "name": str(report["name"])[:MAX_FOLD_NAME],
        "modules": int(report["modules"]),
        "module": str(report["module"]),
        "module_words": report["module_words"],
        "key": options.key,
        "query": urlencode(texts_of(values), safe=","),
    }


def texts_of(options: Mapping[str, Any]) -> dict[str, str]:
    """Return the values of options as a form or an address states them."""
    return {
        name: ",".join(map(str, value))
        if isinstance(value, tuple)
        else str(value).lower()
        if isinstance(value, bool)
        else str(value)
        for name, value in options.items()
    }


@asynccontextmanager
async def asking(request: Request, context: Context) -> AsyncGenerator[Asker]:
    """Yield the client that waits for a report, and watch whether it disconnects."""
    disconnected = threading.Event()

    async def watch() -> None:
        while not await request.is_disconnected():
            await asyncio.sleep(0.1)
        disconnected.set()

    watching = asyncio.create_task(watch())
    try:
        yield Asker(visitor=context.visitor(request), has_disconnected=disconnected.is_set)
    finally:
        watching.cancel()


@router.get(
    "/module.schema.json",
    summary="Get the JSON schema of module files",
    responses={200: {"description": "A JSON schema"}},
)
def get_module_schema() -> Response:
    """Return the schema of `foldback-module/1` files, which describe modules of your own."""
    return Response(json.dumps(module_schema()), media_type="application/schema+json")


@router.get(
    "/{name}.json",
    summary="Get a gallery shape as a path file",
    responses={200: {"description": "A `foldback-path/1` file"}, **problems(404)},
)
def get_shape(name: str, context: Here) -> Response:
    """Return a gallery shape as a path file, for example to edit it."""
    shape = context.gallery.shape(name)
    if shape is None:
        raise NotFound("no-such-shape", "The gallery has no shape of this name.")
    return Response(
        shape.data,
        media_type="application/json",
        headers={"Content-Disposition": f'attachment; filename="{shape.filename}"'},
    )
