"""Finding a fold for a page, without saying more than that there is none."""

from __future__ import annotations

import asyncio
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

RUNNING: Final = ("queued", "running")
"""Statuses of folds that are not over."""
FOLD_ID: Final = re.compile(r"[A-Za-z0-9_-]{1,64}")


@dataclass(frozen=True, slots=True)
class Found:
    """A fold: its row and the directory of its files.

    Attributes:
        recorded: Of a smoothed fold, the id of the one that was smoothed, while that is there.
    """

    row: Any
    directory: Path
    recorded: str | None = None


def find_now(app: Any, fold_id: str) -> Found | None:
    """The fold of that id, or None; asks the database, so not for the event loop's own thread."""
    if not FOLD_ID.fullmatch(fold_id):
        return None
    store = app.state.context.store
    row = _row(store, fold_id)
    if row is None:
        return None
    store.looked(row)
    smooths = getattr(row, "smooths", None)
    recorded = smooths if smooths and _row(store, smooths) is not None else None
    return Found(row, store.folders.shown(row), recorded)


def _row(store: Any, fold_id: str) -> Any:
    try:
        return store.fold(fold_id)
    except LookupError:
        return None


async def find_fold(app: Any, fold_id: str) -> Found | None:
    """The fold of that id, or None."""
    return await asyncio.to_thread(find_now, app, fold_id)


def has_motion(summary: Any) -> bool:
    """Whether a plan of this summary has frames."""
    return bool((summary or {}).get("playback"))
