"""Fold notes: what is shown beside a fold: its tour, its steps, and numbers for its modules."""

from __future__ import annotations

from typing import Any

from foldback.planner.pipeline.fold_layout import stored_moments
from foldback.server.store.fold_files import frames_promised
from foldback.server.store.fold_source import FoldSource, LocatedFold
from foldback.words.fold import RUNNING_STATUSES
from foldback.words.reachability import FullSize, full_size
from foldback.words.tour import draft_tour


def tour_of(
    store: FoldSource, located: LocatedFold, *, draft: bool = False
) -> dict[str, Any] | None:
    """Return the tour of a fold as plain values; None while it runs, or without frames.

    Args:
        store: Store of the fold.
        located: The fold.
        draft: True for a draft even if its owner has stored a tour.
    """
    if located.row.status in RUNNING_STATUSES:
        return None
    stored_tour = None if draft or located.alternative_to else store.tour(located.row.id)
    return stored_tour if stored_tour is not None else draft_of(located)


def draft_of(located: LocatedFold) -> dict[str, Any] | None:
    """Return the draft for a fold that is over as plain values; None without frames."""
    moments = stored_moments(located.derived_dir)
    drafted = draft_tour(located.row, frames_promised(located.directory), moments)
    return None if drafted is None else drafted.as_dict()


def values_of(store: FoldSource, located: LocatedFold) -> dict[str, Any] | None:
    """Return the numbers that are stored with a fold as plain values; None without any."""
    return None if located.alternative_to else store.values(located.row.id)


def full_size_of(located: LocatedFold) -> FullSize | None:
    """Return the verdict on the figure of a fold; None while it runs, or if it gets none."""
    if located.row.status in RUNNING_STATUSES or located.alternative_to is not None:
        return None
    return full_size(located.row, located.directory, located.derived_dir)


def steps_in(located: LocatedFold) -> list[dict[str, Any]] | None:
    """Return the steps of a fold as plain values; None without steps."""
    moments = stored_moments(located.derived_dir)
    return None if moments is None else moments.as_dict().get("steps")
