"""Fold lookup: folds and alternative plans by the id in an address."""

from __future__ import annotations

import asyncio
import re
from dataclasses import dataclass
from typing import Final

from fastapi import Request
from starlette.requests import HTTPConnection

from foldback.server.files.artifacts import Artifacts
from foldback.server.files.fold_figures import FoldFigures
from foldback.server.http.client_address import address_of
from foldback.server.settings import Settings
from foldback.server.store.fold_files import NoSuchFoldError
from foldback.server.store.fold_source import FoldSource, LocatedFold, id_of_fold
from foldback.server.viewing.alternatives import alternative
from foldback.server.viewing.frame_waits import FrameWaits
from foldback.web.timeline.shared_views import TimelineViews

ADDRESS_ID: Final = re.compile(r"[A-Za-z0-9_-]{1,64}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Viewing:
    """Resources that a fold's pages need, in the service or in a viewer of one directory.

    Attributes:
        store: Source of folds.
        timelines: Open timelines.
        waits: Requests that wait for frames.
        artifacts: Files that are computed on request.
        figures: Figures and moments, which are computed on request.
        verdicts: Verdicts on figures, which are computed on request.
        settings: Settings of the service; None in a viewer.
    """

    store: FoldSource
    timelines: TimelineViews
    waits: FrameWaits
    artifacts: Artifacts
    figures: FoldFigures
    verdicts: FoldFigures
    settings: Settings | None


def viewing_of(request: HTTPConnection) -> Viewing:
    """Return the application's ``Viewing`` for a request of a fold's page."""
    viewing: Viewing = request.app.state.context
    return viewing


def find_now(request: Request, fold_id: str) -> LocatedFold | None:
    """Return the fold of that id, or an alternative to its plan, or None.

    It asks the database, so it must not run in the event loop's own thread.
    """
    if not ADDRESS_ID.fullmatch(fold_id):
        return None
    located = viewing_of(request).store.find(id_of_fold(fold_id))
    if located is None or fold_id == located.row.id:
        return located
    return alternative(located, fold_id.removeprefix(f"{located.row.id}-"))


def found_fold(request: Request, fold_id: str) -> LocatedFold:
    """Return the fold of that id.

    Raises:
        NoSuchFoldError: If there is none.
    """
    located = find_now(request, fold_id)
    if located is None:
        raise NoSuchFoldError(fold_id)
    return located


async def with_figures(request: Request, located: LocatedFold) -> LocatedFold:
    """Return a fold with its figures and moments, if they can be computed: see ``FoldFigures``.

    Raises:
        ServiceError: If too many are being computed, or the disk is full.
    """
    return await viewing_of(request).figures.of(located, address_of(request))


async def with_verdict(request: Request, located: LocatedFold) -> LocatedFold:
    """Return a fold with the verdict on its figure, if it can be computed: see ``FoldFigures``.

    Raises:
        ServiceError: If too many are being computed, or the disk is full.
    """
    return await viewing_of(request).verdicts.of(located, address_of(request))


async def find_fold(request: Request, fold_id: str) -> LocatedFold | None:
    """Return the fold of that id, or None."""
    return await asyncio.to_thread(find_now, request, fold_id)
