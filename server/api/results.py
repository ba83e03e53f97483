"""Routes of a fold's results: frames of its timeline, and files to download."""

from __future__ import annotations

import asyncio
from math import isnan
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query, Request
from fastapi.responses import FileResponse, Response
from numpy.typing import NDArray

from foldback.planner.errors import DamagedError, InputError, TimelineError
from foldback.planner.exports.formats import EXPORTS, export_named, exports_of
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.storage.file_names import (
    CERTIFICATE,
    MODEL,
    PLAN,
    PLAN_TEXT,
    RECORD,
    TIMELINE,
)
from foldback.planner.twist_chains.folded_chains import is_coded
from foldback.planner.verification.integrity import check
from foldback.server.context import Context, Here
from foldback.server.dependencies.described_answers import file_or_problems, problems
from foldback.server.dependencies.requested_folds import not_there
from foldback.server.errors import NotFound, Unusable
from foldback.server.files.exports import export_file
from foldback.server.http.client_address import address_of
from foldback.server.http.downloads import download
from foldback.server.schemas import ExportBody, ExportList, FramesBody
from foldback.server.store.folds import FoldRow
from foldback.words.fold import has_motion, step_count

router = APIRouter(prefix="/api/folds/{fold_id}", tags=["artifacts"])
PLAN_MEDIA_TYPES: Final = {
    PLAN: "application/octet-stream",
    RECORD: "application/octet-stream",
    MODEL: "application/xml",
    CERTIFICATE: "application/json",
}


@router.get(
    "/frames",
    summary="Get frames of the timeline",
    response_model=FramesBody,
    responses=problems(404, 409, 422, 429, 503),
)
async def get_frames(
    request: Request,
    fold_id: str,
    context: Here,
    start: Annotated[int, Query(alias="from", ge=0, description="Index of the first frame.")] = 0,
    stop: Annotated[
        int | None, Query(alias="to", ge=0, description="Index of the first frame after the range.")
    ] = None,
    stride: Annotated[int, Query(ge=1, le=1_000_000, description="Return every Nth frame.")] = 1,
    poses: Annotated[bool, Query(description="Include the pose of every module.")] = False,
) -> Response:
    """Return the frames that exist so far, even while the fold runs; `next` links to the rest."""
    timeline = await asyncio.to_thread(_timeline, context, fold_id)
    total = len(timeline)
    end = total if stop is None else min(stop, total)
    if start > end:
        raise Unusable(
            "no-such-frames",
            "got frames {start} to {end}, expected a range within the fold's {frames} frames.",
            where="query.from",
            start=start,
            end=end,
            frames=total,
        )
    numbers = 2 * len(timeline.chain.joint_names) + (7 * len(timeline.chain) if poses else 0)
    settings = context.settings
    max_frames = max(1, min(settings.frames_per_answer, settings.numbers_per_answer // numbers))
    until = min(end, start + max_frames * stride)
    next_path = f"/api/folds/{fold_id}/frames?from={until}&to={end}&stride={stride}"
    if poses:
        next_path += "&poses=true"

    def make() -> str:
        body = _frames(timeline, start, until, stride, poses=poses)
        body.next = next_path if until < end else None
        return body.model_dump_json(by_alias=True)

    # larger answers wait in the queue of derived files
    if numbers * ((until - start) // stride) > 100_000:
        key = (fold_id, total, start, stop, stride, poses)
        data = await context.answers.get_or_make(key, make, visitor=address_of(request))
    else:
        data = await asyncio.to_thread(make)
    return Response(data, media_type="application/json")


def _timeline(context: Context, fold_id: str) -> Timeline:
    """Return the timeline of a fold.

    Raises:
        NotFound: If the fold ended without one.
        Conflict: If it does not exist yet.
    """
    row, directory = context.store.fold(fold_id), context.store.directory(fold_id)
    if row.over:
        check(directory, TIMELINE)
    try:
        return Timeline.open(result_path(directory, TIMELINE))
    except DamagedError:
        raise
    except (TimelineError, OSError, KeyError) as error:  # or it is just being replaced
        raise not_there(row, "timeline") from error


def _frames(timeline: Timeline, start: int, until: int, stride: int, *, poses: bool) -> FramesBody:
    """Return a range of a timeline, without a link to the rest."""
    from foldback.planner.motion.motion import PHASES

    chain = timeline.chain
    frames = timeline.frames(start, until, stride)
    largest = frames.largest_errors
    positions = wxyzs = None
    if poses:
        frame_poses = frames.poses(chain)
        positions, wxyzs = _short(frame_poses.positions), _short(frame_poses.wxyzs)
    return FramesBody(
        status=timeline.status,
        total=len(timeline),
        start=start,
        stop=until,
        stride=stride,
        next=None,
        phases=list(PHASES),
        joint_names=list(chain.joint_names),
        time_s=_short(frames.time_s),
        phase=frames.phase.tolist(),
        joint_angles_rad=_short(frames.joint_angles_rad),
        root_position=_short(frames.root_position),
        root_wxyz=_short(frames.root_wxyz),
        max_error_rad=[None if isnan(error) else error for error in _short(largest)],
        positions=positions,
        wxyzs=wxyzs,
    )


@router.get(
    "/exports",
    summary="List download formats of a finished fold",
    responses=problems(404, 409),
)
def get_exports(fold_id: str, context: Here) -> ExportList:
    """List the downloadable files for other programs, ordered as on the fold's page."""
    row = _finished(context, fold_id)
    exports = exports_of(
        moving=has_motion(row.summary),
        resting=step_count(row.summary) > 0,
        coded=is_coded(row.module),
    )
    return ExportList(exports=[ExportBody.of(fold_id, export) for export in exports])


@router.get(
    "/exports/{name}",
    summary="Download a fold in one of the listed formats",
    response_class=FileResponse,
    responses=file_or_problems(
        "The file. It is created on the first request.",
        *(export.media_type for export in EXPORTS),
        problem=(404, 409, 413, 429, 503, 507),
    ),
)
async def get_export(request: Request, fold_id: str, name: str, context: Here) -> FileResponse:
    """Return a file in one of the listed formats."""
    row = await asyncio.to_thread(_finished, context, fold_id)
    try:
        export = export_named(name)
    except InputError as error:
        raise NotFound("no-such-export", error.detail) from error
    path = await export_file(
        context.store, context.artifacts, fold_id, export, visitor=address_of(request)
    )
    if export.shared:
        return FileResponse(path, media_type=export.media_type, filename=export.filename)
    return download(path, export.media_type, row.name, f"-{export.filename}")


def _file(name: str) -> None:
    @router.get(
        f"/{name}",
        summary=f"Download {name}",
        response_class=FileResponse,
        responses=file_or_problems("The file", PLAN_MEDIA_TYPES[name], problem=(404, 409)),
        name=name,
        operation_id=f"get_{name.replace('.', '_')}",
    )
    def get_file(fold_id: str, context: Here) -> FileResponse:
        row = context.store.fold(fold_id)
        path = context.store.directory(fold_id) / name
        if row.over:
            check(path.parent, name)
        if not row.over or not path.is_file():
            raise not_there(row, name)
        return download(path, PLAN_MEDIA_TYPES[name], row.name, f"-{name}")


for _name in PLAN_MEDIA_TYPES:
    _file(_name)


@router.get(
    f"/{PLAN_TEXT}",
    summary=f"Download {PLAN_TEXT}",
    response_class=FileResponse,
    responses=file_or_problems(
        "The file. It is created on the first request.",
        "application/json",
        problem=(404, 409, 413, 429, 503, 507),
    ),
)
async def get_plan_json(request: Request, fold_id: str, context: Here) -> FileResponse:
    """Return the values of the plan as text."""
    row = await asyncio.to_thread(_finished, context, fold_id)
    export = export_named("json")
    path = await export_file(
        context.store, context.artifacts, fold_id, export, visitor=address_of(request)
    )
    return download(path, export.media_type, row.name, f"-{export.filename}")


def _finished(context: Context, fold_id: str) -> FoldRow:
    """Return the row of a fold that has a plan."""
    row = context.store.fold(fold_id)
    context.store.looked(row)
    if not row.over or not (context.store.directory(fold_id) / PLAN).is_file():
        raise not_there(row, "plan")
    return row


def _short(values: NDArray[Any]) -> Any:
    """Return values as JSON numbers, rounded to 9 decimals, finer than any visible difference."""
    return values.round(9).tolist()
