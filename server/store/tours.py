"""Tours that owners have written for their folds."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from server.store.folds import Store
from server.store.owner import Owner, owned_by
from server.store.tables import FoldRow, TourRow


def write_tour(store: Store, fold_id: str, owner: Owner, tour: dict[str, Any] | None) -> bool:
    """Store the tour of a fold, in place of an earlier one, or remove it.

    Args:
        store: The rows.
        fold_id: The fold.
        owner: Its owner.
        tour: The tour as plain values; None to remove it.

    Returns:
        False if the fold does not belong to the owner; gallery folds belong to none.
    """
    own = (FoldRow.id == fold_id, owned_by(owner), FoldRow.public.is_(False))
    with store.changing() as session:
        if session.scalar(sa.select(FoldRow.id).where(*own).with_for_update()) is None:
            return False
        if tour is None:
            session.execute(sa.delete(TourRow).where(TourRow.fold_id == fold_id))
        else:
            session.merge(TourRow(fold_id=fold_id, tour=tour))
        return True
