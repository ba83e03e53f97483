"""Player data: chain, frames and figures of a fold for browsers, read from its timeline.

``/view`` is viser's client, the same for every fold, so that browsers can cache it. The page that
embeds it passes it the fold's bundle (``web.viser.scene_bundle``) and then frames from the fold's
batches (``web.timeline.frame_batch``). Scrubbing thus does not depend on the network's latency.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import cache
from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse, Response

from foldback.planner.parameters.parameters import FLOATING
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.storage.file_names import EXHAUSTION, TIMELINE
from foldback.planner.verification.integrity import check
from foldback.server.http.client_address import address_of
from foldback.server.http.downloads import BINARY_MEDIA_TYPE, Asset, download, revalidated
from foldback.server.http.response_cache import mark
from foldback.server.store.fold_source import FoldSource, LocatedFold
from foldback.server.viewing.fold_lookup import (
    found_fold,
    viewing_of,
    with_figures,
    with_verdict,
)
from foldback.server.viewing.fold_notes import full_size_of, steps_in, tour_of, values_of
from foldback.web.timeline.figures import FIGURES, cached_figures
from foldback.web.timeline.frame_batch import cached_batch
from foldback.web.timeline.shared_views import unless_replaced
from foldback.web.timeline.view import TimelineView
from foldback.web.viser.client import client
from foldback.web.viser.scene_bundle import bundle_of
from foldback.words.fold import RUNNING_STATUSES, ShownFold

router = APIRouter(include_in_schema=False)


@router.get("/view")
async def view(request: Request) -> Response:
    """Return the page of the 3D viewer viser, which the fold's page embeds in an iframe."""
    page = await asyncio.to_thread(view_page)
    headers = {"Content-Security-Policy": client().policy, "X-Frame-Options": "SAMEORIGIN"}
    return page.response(request, headers)


@cache
def view_page() -> Asset:
    """Return viser's client."""
    return Asset.of(client().html, "text/html")


@router.get("/folds/{fold_id}/bundle")
async def bundle(request: Request, fold_id: str) -> Response:
    """Return a fold's chain and scene, with the id of its timeline."""

    def answer() -> Response:
        row, timeline = _view(request, fold_id)
        if timeline is not None:
            with unless_replaced():
                table = None if row.world == FLOATING else timeline.table()
                data = bundle_of(timeline.chain, timeline.stretch, table)
                return _binary(request, data, timeline)
        return _nothing()

    return await asyncio.to_thread(answer)


@router.get("/folds/{fold_id}/batch")
async def batch(
    request: Request,
    fold_id: str,
    start: Annotated[int, Query(alias="from", ge=0)] = 0,
    stop: Annotated[int | None, Query(alias="to", ge=0)] = None,
    stride: Annotated[int, Query(ge=1, le=1_000_000)] = 1,
    wait: Annotated[float, Query(ge=0, le=2.0)] = 0.0,
) -> Response:
    """Return frames of a fold's timeline; wait at most ``wait`` seconds for the first one.

    Raises:
        TooMany: If too many requests are waiting: of this visitor, of the visitor's network, or of
            all visitors.
    """

    def answer(view: TimelineView | None = None) -> Response:
        timeline = view or _view(request, fold_id)[1]
        if timeline is not None:
            with unless_replaced():
                return _binary(request, cached_batch(timeline, start, stop, stride), timeline)
        return _nothing()

    if not wait:
        return await asyncio.to_thread(answer)
    waits = viewing_of(request).waits
    with waits.place(address_of(request)) as over:
        _, timeline = await asyncio.to_thread(_view, request, fold_id)
        if timeline is not None and start >= len(timeline) and timeline.growing:
            await waits.until(timeline, start, over, timeout_s=wait)
        return await asyncio.to_thread(answer, timeline)


@router.get("/folds/{fold_id}/figures")
async def figures(
    request: Request,
    fold_id: str,
    part: Annotated[int | None, Query(ge=0, le=1_000_000)] = None,
) -> Response:
    """Return the curves of a finished fold's plot; they are computed on the first request.

    With ``part``, return all figures of one range of frames; the ranges are numbered from 0.
    """
    located = await with_figures(request, await asyncio.to_thread(found_fold, request, fold_id))

    def answer() -> Response:
        if located.row.status in RUNNING_STATUSES:
            return _nothing()
        check(located.directory, TIMELINE, FIGURES)
        mark(request, located.row)
        with unless_replaced(OSError):
            return _kept(request, cached_figures(located.directory, located.derived_dir, part))
        return _nothing()

    return await asyncio.to_thread(answer)


@router.get("/folds/{fold_id}/tour.json")
async def tour(request: Request, fold_id: str) -> Response:
    """Return the stored tour of a fold for its pages, or a draft if none is stored."""
    return await _stored(request, fold_id, tour_of, derived=True)


@router.get("/folds/{fold_id}/values.json")
async def values(request: Request, fold_id: str) -> Response:
    """Return the numbers that are stored with a fold, for its pages; 204 if there are none."""
    return await _stored(request, fold_id, values_of)


@router.get("/folds/{fold_id}/steps.json")
async def steps(request: Request, fold_id: str) -> Response:
    """Return the steps of a fold for its pages; 204 if its plan does not rest between steps."""
    return await _stored(request, fold_id, lambda _, located: steps_in(located), derived=True)


@router.get("/folds/{fold_id}/verdict.json")
async def verdict(request: Request, fold_id: str) -> Response:
    """Return whether turns at full size lead to the figure of a fold; 204 if it has no verdict.

    It is computed on the first request.
    """
    located = await with_verdict(request, await asyncio.to_thread(found_fold, request, fold_id))
    words = await asyncio.to_thread(full_size_of, located)
    if words is None or not words["text"]:
        return _nothing()
    return JSONResponse(words, headers={"Cache-Control": "private, no-cache"})


@router.get("/folds/{fold_id}/exhaustion.json")
async def exhaustion(request: Request, fold_id: str) -> Response:
    """Return the proof that single turns do not lead to the figure of a fold; 204 without one."""
    located = await with_verdict(request, await asyncio.to_thread(found_fold, request, fold_id))

    def answer() -> Response:
        words, path = full_size_of(located), located.derived_dir / EXHAUSTION
        if words is None or not words["has_proof"] or not path.exists():
            return _nothing()
        return download(path, "application/json", located.row.called, "-exhaustion.json")

    return await asyncio.to_thread(answer)


async def _stored(
    request: Request,
    fold_id: str,
    of: Callable[[FoldSource, LocatedFold], object],
    *,
    derived: bool = False,
) -> Response:
    """Return the values stored with a fold; 204 if there are none.

    Args:
        request: The request.
        fold_id: Id of the fold.
        of: Returns the values.
        derived: True if they may need the fold's moments.
    """
    located = await asyncio.to_thread(found_fold, request, fold_id)
    if derived:
        located = await with_figures(request, located)
    notes = await asyncio.to_thread(of, viewing_of(request).store, located)
    if notes is None:
        return _nothing()
    return JSONResponse(notes, headers={"Cache-Control": "private, no-cache"})


def _binary(request: Request, data: bytes, timeline: TimelineView) -> Response:
    if timeline.growing:
        return Response(data, media_type=BINARY_MEDIA_TYPE, headers={"Cache-Control": "no-store"})
    return _kept(request, data)


def _kept(request: Request, data: bytes) -> Response:
    headers = {"Cache-Control": "private, no-cache"}
    return revalidated(request, data, BINARY_MEDIA_TYPE, headers)


def _nothing() -> Response:
    """Return the response without content, used while there are no frames yet."""
    return Response(status_code=204, headers={"Cache-Control": "no-store"})


def _view(request: Request, fold_id: str) -> tuple[ShownFold, TimelineView | None]:
    located = found_fold(request, fold_id)
    if located.row.status not in RUNNING_STATUSES:
        check(located.directory, TIMELINE)
    timeline = viewing_of(request).timelines.get(result_path(located.directory, TIMELINE))
    if timeline is not None and not timeline.growing:
        mark(request, located.row)
    return located.row, timeline if timeline is not None and len(timeline) else None
