"""Tours and numbers of modules that owners have stored with their folds."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from server.store.folds import Store
from server.store.owner import Owner, owned_by
from server.store.tables import FoldRow, TourRow, ValuesRow


def write_beside(
    store: Store,
    fold_id: str,
    owner: Owner,
    kind: type[TourRow | ValuesRow],
    told: dict[str, Any] | None,
) -> bool:
    """Store something with a fold, in place of what was there, or remove it.

    Args:
        store: The rows.
        fold_id: The fold.
        owner: Its owner.
        kind: Table: tours, or values of modules.
        told: Its plain values; None to remove it.

    Returns:
        False if the fold does not belong to the owner; gallery folds belong to none.
    """
    own = (FoldRow.id == fold_id, owned_by(owner), FoldRow.public.is_(False))
    with store.changing() as session:
        if session.scalar(sa.select(FoldRow.id).where(*own).with_for_update()) is None:
            return False
        if told is None:
            session.execute(sa.delete(kind).where(kind.fold_id == fold_id))
        else:
            session.merge(kind(fold_id=fold_id, told=told))
        return True
