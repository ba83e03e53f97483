"""Pictures: what networks show beside a link to a fold."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hashlib
import json
from pathlib import Path
from typing import Annotated, Final

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from planner.errors import DamagedError, InputError, TimelineError
from planner.file_names import CHAIN, TIMELINE
from planner.files import write_whole
from planner.pipeline.fold_layout import result_path
from planner.verification.integrity import check
from server.api.context import Context, context_of
from server.api.fold_lookup import find_fold
from server.errors import read_only
from server.files.artifacts import newer
from server.files.pictures import moment_of
from server.http.client_address import address_of
from server.http.security import INDEXED_HEADERS
from server.pages.fold import drawing_in
from server.pages.page import drawing, not_found
from server.processes.children import ChildError
from server.store.fold_files import EXPORTS_DIR
from server.store.fold_source import Found
from web.pictures.picture_view import MAX_SHORT_FORM_LENGTH, SHORT_FORM_PATTERN
from words.fold import RUNNING_STATUSES
from words.verdict import COMPUTING_VERDICT, PICTURE_VERDICTS

router = APIRouter(include_in_schema=False)

CARD_PREFIX: Final = "card"
"""Prefix of the names of files that cache a fold's preview picture; older pictures are found by it
and deleted."""
FINAL_PICTURE_AGE_S: Final = 86400
"""Time for which browsers may cache the preview picture of a finished fold, in s. A larger value
needs fewer requests, and shows a new name of the fold later. Chosen."""
RUNNING_PICTURE_AGE_S: Final = 60
"""Time for which browsers may cache the preview picture of a running fold, in s. A larger value
shows the result later. Chosen."""


@router.get("/folds/{fold_id}/drawing.svg")
async def drawing_of_fold(request: Request, fold_id: str) -> Response:
    """Return a fold's drawing for lists, or an empty one if the shape is too large.

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


@router.get("/folds/{fold_id}/picture.png")
async def picture_of_fold(
    request: Request,
    fold_id: str,
    view: Annotated[
        str | None, Query(pattern=SHORT_FORM_PATTERN, max_length=MAX_SHORT_FORM_LENGTH)
    ] = None,
) -> Response:
    """Return a picture of 1200×630 pixels: the folded shape, or the view that ``view`` names."""
    found = await find_fold(request, fold_id)
    if found is None:
        return not_found()
    if view is not None:
        return await _picture_of_view(request, found, view)
    path = found.directory / EXPORTS_DIR / file_of(found.row.title, found.row.status)
    over = found.row.status not in RUNNING_STATUSES
    data = None
    if over:
        await asyncio.to_thread(check, found.directory, CHAIN)
        data = await asyncio.to_thread(_stored_picture, path)
    if data is None:
        # A crowd that comes with a link waits for the first one's.
        context = context_of(request)
        data = await context.artifacts.flight.get_or_make(
            (path, over),
            lambda: _picture_of(context, found, path, keep=over),
            visitor=address_of(request),
        )
    return not_found() if data is None else picture_answer(data, listed=found.row.public, over=over)


async def _picture_of_view(request: Request, found: Found, view: str) -> Response:
    """Return the picture of a moment, seen as a link says; kept in memory for a while."""
    context, row = context_of(request), found.row
    over = row.status not in RUNNING_STATUSES
    if over:
        await asyncio.to_thread(check, found.directory, CHAIN, TIMELINE)
    recent = context.pictures.recent
    key = (row.id, row.title, row.status, view)

    def drawn() -> bytes | None:
        if over and (known := recent.get(key)) is not None:  # drawn while this one waited
            return known
        made = _drawn(context, found, view)
        if over and made is not None:
            recent.keep(key, made)
        return made

    data = recent.get(key) if over else None
    if data is None:
        data = await context.artifacts.flight.get_or_make(key, drawn, visitor=address_of(request))
    return not_found() if data is None else picture_answer(data, listed=row.public, over=over)


def _drawn(context: Context, found: Found, view: str | None = None) -> bytes | None:
    """Return the picture of a fold, seen as a link says; None where it cannot be drawn.

    Raises:
        DamagedError: If its frames are damaged.
        NoRoom: If nothing can be written.
    """
    caption = caption_of(found.row.title, found.row.status)
    try:
        frames = result_path(found.directory, TIMELINE)
        moment = moment_of(caption, view, context.timelines.get(frames) if view else None)
        return context.pictures.drawn(result_path(found.directory, CHAIN), moment)
    except DamagedError:
        raise
    except (InputError, ChildError, OSError, TimelineError) as error:
        became_read_only = isinstance(error, OSError) and error.errno == errno.EROFS
        if context.settings.read_only or became_read_only:
            raise read_only() from error
        return None


def caption_of(title: str, status: str) -> dict[str, str]:
    """Return what a picture says of a fold: its name, and in a few words how it ended."""
    verdict, tone = PICTURE_VERDICTS.get(status, COMPUTING_VERDICT)
    return {"name": title, "verdict": verdict, "tone": tone}


def file_of(title: str, status: str) -> str:
    """Return the file of a fold's picture; another one once it has another name or verdict."""
    digest = hashlib.sha256(json.dumps(caption_of(title, status)).encode()).hexdigest()[:8]
    return f"{CARD_PREFIX}-{digest}.png"


def picture_answer(data: bytes, *, listed: bool, over: bool = True) -> Response:
    """Return a picture that other sites may show.

    Args:
        data: The PNG file.
        listed: True if search engines may index it and caches hold it; otherwise only browsers may,
            which ask each time.
        over: False while another candidate may take the place of this one.
    """
    headers = {
        "Cache-Control": "private, no-cache",
        "Content-Security-Policy": "default-src 'none'",
        "Cross-Origin-Resource-Policy": "cross-origin",  # it is made to be shown elsewhere
    }
    if listed:
        max_age_s = FINAL_PICTURE_AGE_S if over else RUNNING_PICTURE_AGE_S
        headers |= {"Cache-Control": f"public, max-age={max_age_s}", **INDEXED_HEADERS}
    return Response(data, media_type="image/png", headers=headers)


def _stored_picture(path: Path) -> bytes | None:
    """Return the picture in a fold's directory, if it is one of its chain."""
    try:
        return path.read_bytes() if newer(path, result_path(path.parent.parent, CHAIN)) else None
    except OSError:
        return None


def _picture_of(context: Context, found: Found, path: Path, *, keep: bool) -> bytes | None:
    """Return the picture of the chain in a fold's directory; None where it cannot be drawn."""
    if keep and (known := _stored_picture(path)):  # drawn since the request looked for it
        return known
    store, data = context.store, _drawn(context, found)
    if data is not None and keep:
        with contextlib.suppress(OSError):  # a full disk takes no picture from anybody
            before = 0
            for other in path.parent.glob(f"{CARD_PREFIX}-*.png"):
                before += other.stat().st_size
                other.unlink()
            path.parent.mkdir(exist_ok=True)
            write_whole(path, data)
            if store.folders.storage is None:
                store.add_derived(found.row.id, len(data) - before)
    return data
