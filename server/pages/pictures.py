"""Pictures: previews of folds that social networks show beside a link."""

from __future__ import annotations

import asyncio
import errno
from functools import lru_cache
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from foldback.planner.errors import DamagedError, InputError, TimelineError
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.storage.file_names import CHAIN, TIMELINE
from foldback.planner.verification.integrity import check
from foldback.server.context import Context, context_of
from foldback.server.errors import read_only
from foldback.server.files.pictures import moment_of
from foldback.server.http.client_address import address_of
from foldback.server.http.security import INDEXED_HEADERS
from foldback.server.pages.fold import drawing_in
from foldback.server.pages.page import drawing, not_found
from foldback.server.processes.children import ChildError
from foldback.server.store.fold_source import LocatedFold
from foldback.server.viewing.fold_lookup import find_fold
from foldback.web.pictures.picture_view import MAX_SHORT_FORM_LENGTH, SHORT_FORM_PATTERN
from foldback.web.timeline.folding_drawing import folding_drawing
from foldback.web.timeline.view import TimelineView
from foldback.words.fold import RUNNING_STATUSES
from foldback.words.verdict import COMPUTING_VERDICT, PICTURE_VERDICTS

router = APIRouter(include_in_schema=False)


@router.get("/folds/{fold_id}/drawing.svg")
async def drawing_of_fold(request: Request, fold_id: str) -> Response:
    """Return the drawing of a fold for lists; it is empty if the shape is too large.

    A request does not count as a view of the fold, so it does not postpone the fold's expiry.
    """

    def drawn() -> tuple[str, bool]:
        store = context_of(request).store
        row = store.fold(fold_id)
        directory = store.folders.shown(row)
        if row.over:
            check(directory, CHAIN)
        return drawing_in(directory), row.over

    svg, over = await asyncio.to_thread(drawn)
    return drawing(svg, "private, max-age=3600" if over else "no-store")


@router.get("/folds/{fold_id}/motion.svg")
async def motion_of_fold(request: Request, fold_id: str) -> Response:
    """Return the drawing of a finished fold in which its chain folds; 404 without such a motion.

    As for its drawing, a request does not count as a view of the fold.
    """

    def drawn() -> str:
        context = context_of(request)
        row = context.store.fold(fold_id)
        if not row.over:
            return ""
        directory = context.store.folders.shown(row)
        check(directory, CHAIN, TIMELINE)
        frames = result_path(directory, TIMELINE)
        return _motion_in(frames, frames.stat().st_mtime_ns) if frames.exists() else ""

    return drawing(await asyncio.to_thread(drawn), "private, max-age=3600")


@lru_cache(maxsize=64)
def _motion_in(frames: Path, _changed_ns: int) -> str:
    return folding_drawing(TimelineView(frames))


@router.get("/folds/{fold_id}/picture.png")
async def picture_of_fold(
    request: Request,
    fold_id: str,
    view: Annotated[
        str | None, Query(pattern=SHORT_FORM_PATTERN, max_length=MAX_SHORT_FORM_LENGTH)
    ] = None,
) -> Response:
    """Return a picture of 1200×630 pixels: the folded shape, or the view that ``view`` names."""
    located = await find_fold(request, fold_id)
    if located is None:
        return not_found()
    context, row = context_of(request), located.row
    over = row.status not in RUNNING_STATUSES
    data = await context.artifacts.flight.get_or_make(
        (row.id, row.title, row.status, view, await asyncio.to_thread(_changed_ns, located, view)),
        lambda: _drawn(context, located, view),
        visitor=address_of(request),
        cache=context.pictures.recent if over else None,
    )
    return not_found() if data is None else picture_answer(data, listed=row.public, over=over)


def _changed_ns(located: LocatedFold, view: str | None) -> int:
    """Return the time when the displayed chain was written, ns since 1970; 0 without a chain.

    Raises:
        DamagedError: If a file of a finished fold that the picture needs is damaged.
    """
    if located.row.status not in RUNNING_STATUSES:
        check(located.directory, CHAIN, *(() if view is None else (TIMELINE,)))
    chain = result_path(located.directory, CHAIN)
    return chain.stat().st_mtime_ns if chain.exists() else 0


def _drawn(context: Context, located: LocatedFold, view: str | None) -> bytes | None:
    """Return the picture of a fold in the view of a link; None if it cannot be drawn.

    Raises:
        DamagedError: If its frames are damaged.
        NoRoom: If nothing can be written.
    """
    caption = caption_of(located.row.title, located.row.status)
    try:
        frames = result_path(located.directory, TIMELINE)
        moment = moment_of(caption, view, context.timelines.get(frames) if view else None)
        return context.pictures.drawn(result_path(located.directory, CHAIN), moment)
    except DamagedError:
        raise
    except (InputError, ChildError, OSError, TimelineError) as error:
        became_read_only = isinstance(error, OSError) and error.errno == errno.EROFS
        if context.settings.read_only or became_read_only:
            raise read_only() from error
        return None


def caption_of(title: str, status: str) -> dict[str, str]:
    """Return the caption of a fold's picture: its name, and its result in a few words."""
    verdict, tone = PICTURE_VERDICTS.get(status, COMPUTING_VERDICT)
    return {"name": title, "verdict": verdict, "tone": tone}


def picture_answer(data: bytes, *, listed: bool, over: bool = True) -> Response:
    """Return a picture that other sites may show.

    Args:
        data: The PNG file.
        listed: True if search engines may index it and shared caches may store it; otherwise only
            browsers may store it, and must revalidate it each time.
        over: False while the fold is running, and its picture may change.
    """
    headers = {
        "Cache-Control": "private, no-cache",
        "Content-Security-Policy": "default-src 'none'",
        "Cross-Origin-Resource-Policy": "cross-origin",  # other sites are meant to show it
    }
    if listed:
        max_age_s = 86400 if over else 60  # a day, or a minute while it runs
        headers |= {"Cache-Control": f"public, max-age={max_age_s}", **INDEXED_HEADERS}
    return Response(data, media_type="image/png", headers=headers)
