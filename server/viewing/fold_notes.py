"""Fold notes: what is shown beside a fold: its tour, its steps, and numbers for its modules."""

from __future__ import annotations

from typing import Any

from foldback.planner.pipeline.fold_layout import stored_moments
from foldback.server.store.fold_files import frames_promised
from foldback.server.store.fold_source import FoldSource, Found
from foldback.words.fold import RUNNING_STATUSES
from foldback.words.tour import draft_tour


def tour_of(store: FoldSource, found: Found, *, draft: bool = False) -> dict[str, Any] | None:
    """Return the tour of a fold as plain values; None while it runs, or without frames.

    Args:
        store: Store of the fold.
        found: The fold.
        draft: True for a draft even if its owner has stored a tour.
    """
    if found.row.status in RUNNING_STATUSES:
        return None
    kept = None if draft or found.alternative_to else store.tour(found.row.id)
    return kept if kept is not None else draft_of(found)


def draft_of(found: Found) -> dict[str, Any] | None:
    """Return the draft for a fold that is over as plain values; None without frames."""
    moments = stored_moments(found.directory)
    drafted = draft_tour(found.row, frames_promised(found.directory), moments)
    return None if drafted is None else drafted.as_dict()


def values_of(store: FoldSource, found: Found) -> dict[str, Any] | None:
    """Return the numbers that are stored with a fold as plain values; None without any."""
    return None if found.alternative_to else store.values(found.row.id)


def steps_in(found: Found) -> list[dict[str, Any]] | None:
    """Return the steps of a fold as plain values; None without steps."""
    moments = stored_moments(found.directory)
    return None if moments is None else moments.as_dict().get("steps")
