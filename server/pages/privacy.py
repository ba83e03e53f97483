"""Privacy: stored data, its lifetime and its visibility, by the settings."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from foldback.server.context import context_of
from foldback.server.jobs.housekeeping import CANCELLED_FOLD_S, MIN_UNUSED_S
from foldback.server.pages.page import page
from foldback.server.settings import Settings
from foldback.words.fold import ShownFold
from foldback.words.lifetime import kept_words, time_words, who_and_how_long

router = APIRouter(include_in_schema=False)


@router.get("/privacy", response_class=HTMLResponse)
async def privacy(request: Request) -> Response:
    """Return the page that lists what the service stores about visitors."""
    settings = context_of(request).settings
    return page(
        "privacy.html",
        listed=True,
        kept=kept(settings),
        room=_limited(settings),
        fresh=time_words(MIN_UNUSED_S),
        preview=time_words(settings.preview_keep_s),
        cancelled=time_words(CANCELLED_FOLD_S),
        movies=settings.movies_of_fold,
        imprint=settings.imprint_url,
    )


def kept(settings: Settings) -> str:
    """Return a sentence that states for how long a fold is stored."""
    return kept_words(settings.keep_days, limited=_limited(settings))


def visibility(settings: Settings, fold: ShownFold | None = None) -> str:
    """Return who can see a fold and how long it is stored; without a fold, for the next one."""
    return who_and_how_long(fold, kept(settings), cancelled_s=CANCELLED_FOLD_S)


def _limited(settings: Settings) -> bool:
    return settings.storage_bytes is not None or settings.storage_of_visitor_bytes is not None
