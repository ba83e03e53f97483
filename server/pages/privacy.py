"""Privacy: stored data, its lifetime and its visibility, by the settings."""

from __future__ import annotations

from typing import Final

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from server.api.context import context_of
from server.jobs.housekeeping import CANCELLED_FOLD_S, MIN_UNUSED_S
from server.pages.page import page
from server.settings import Settings
from words.fold import ShownFold

router = APIRouter(include_in_schema=False)

TIME_UNITS: Final = ((86400.0, "day"), (3600.0, "hour"), (60.0, "minute"), (1.0, "second"))
LINK_ONLY: Final = "Only people with the link can see it."
PUBLIC_FOLD: Final = "Gallery fold: everyone can see it, and it won't expire."


@router.get("/privacy", response_class=HTMLResponse)
async def privacy(request: Request) -> Response:
    """Return the page that lists what the service stores about visitors."""
    settings = context_of(request).settings
    return page(
        "privacy.html",
        listed=True,
        kept=kept_words(settings),
        room=settings.storage_bytes is not None or settings.storage_of_visitor_bytes is not None,
        fresh=time_words(MIN_UNUSED_S),
        preview=time_words(settings.preview_keep_s),
        cancelled=time_words(CANCELLED_FOLD_S),
        movies=settings.movies_of_fold,
        imprint=settings.imprint_url,
    )


def kept_words(settings: Settings) -> str:
    """Return a sentence that states for how long a fold is stored."""
    if settings.keep_days is not None:
        return f"Stored for {time_words(86400.0 * settings.keep_days)} after it was last viewed."
    if settings.storage_bytes is not None or settings.storage_of_visitor_bytes is not None:
        return (
            "Stored while there is space; the folds that have gone unviewed for longest are "
            "deleted first."
        )
    return "Stored until you delete it."


def who_and_how_long(settings: Settings, fold: ShownFold | None = None) -> str:
    """Return who can see a fold and how long it is stored; without a fold, for the next one."""
    if fold is not None and fold.public:
        return PUBLIC_FOLD
    if fold is not None and fold.pinned:
        kept = "Stored permanently."
    elif fold is not None and fold.status == "cancelled":
        kept = f"Cancelled: its files will be deleted within {time_words(CANCELLED_FOLD_S)}."
    else:
        kept = kept_words(settings)
    return f"{kept} {LINK_ONLY}"


def time_words(seconds: float) -> str:
    """Return a time in its largest unit that leaves no rest of more than a tenth: ``30 days``."""
    for length, name in TIME_UNITS:
        count = round(seconds / length)
        if count and abs(count * length - seconds) <= 0.1 * seconds:
            return f"{count} {name}{'' if count == 1 else 's'}"
    return f"{seconds:g} seconds"
