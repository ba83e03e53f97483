"""Finding a fold for a page, without saying more than that there is none."""

from __future__ import annotations

import asyncio
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

FOLD_ID: Final = re.compile(r"[A-Za-z0-9_-]{1,64}")


@dataclass(frozen=True, slots=True)
class Found:
    """A fold: its row and the directory of its files."""

    row: Any
    directory: Path


def find_now(app: Any, fold_id: str) -> Found | None:
    """The fold of that id, or None; asks the database, so not for the event loop's own thread."""
    if not FOLD_ID.fullmatch(fold_id):
        return None
    store = app.state.context.store
    try:
        row = store.fold(fold_id)
    except LookupError:
        return None
    if row is None:
        return None
    store.looked(row)
    return Found(row, store.folders.shown(row))


async def find_fold(app: Any, fold_id: str) -> Found | None:
    """The fold of that id, or None."""
    return await asyncio.to_thread(find_now, app, fold_id)
