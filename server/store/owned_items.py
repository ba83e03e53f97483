"""Owned items: lists and changes of the folds, previews and movies of an owner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from foldback.server.store.folds import Store, rows_of
from foldback.server.store.owner import Owner, owned_by
from foldback.server.store.schema import FoldRow, MovieRow, PreviewRow, TourRow, ValuesRow


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnedFolds:
    """One page of an owner's folds.

    Attributes:
        rows: Rows of the folds, newest first.
        next: Cursor of the next page; None on the last one.
        total: Number of the owner's folds.
    """

    rows: Sequence[FoldRow]
    next: str | None
    total: int


def folds_made(store: Store, owner: Owner, *, before: str | None, limit: int) -> OwnedFolds:
    """Return the folds that an owner was the first to request.

    Args:
        store: The rows.
        owner: The owner.
        before: Cursor ``created_at,id``: the ``next`` of the previous page; None for the first.
        limit: Maximum number to return.
    """
    is_made_by_owner = owned_by(owner, FoldRow.maker)
    query = sa.select(FoldRow).where(is_made_by_owner)
    if before is not None:
        at, _, last = before.partition(",")
        older = FoldRow.created_at < float(at)
        query = query.where(
            sa.or_(older, sa.and_(FoldRow.created_at == float(at), FoldRow.id < last))
        )
    newest_first = query.order_by(FoldRow.created_at.desc(), FoldRow.id.desc())
    with store.reading() as session:
        total = session.scalar(sa.select(sa.func.count()).where(is_made_by_owner)) or 0
        rows = session.scalars(newest_first.limit(limit + 1)).all()
    has_more = len(rows) > limit
    rows = rows[:limit]
    return OwnedFolds(
        rows=rows, next=f"{rows[-1].created_at!r},{rows[-1].id}" if has_more else None, total=total
    )


def change_fold(
    store: Store, fold_id: str, owner: Owner, *, name: str | None, heir: Owner | None
) -> bool:
    """Rename a fold or transfer it to an heir; return False if it is not the owner's.

    After a transfer, the same upload creates a new fold.
    """
    values = {
        **({} if name is None else {"name": name, "renamed": True}),
        **(
            {}
            if heir is None
            else {"owner": heir.digest, "maker": heir.digest, "content_key": None}
        ),
    }
    if not values:
        return store.owns(fold_id, owner)
    update = sa.update(FoldRow).where(
        FoldRow.id == fold_id, owned_by(owner), FoldRow.public.is_(False)
    )
    return bool(store.change(update.values(**values)))


def write_beside(
    store: Store,
    fold_id: str,
    owner: Owner,
    kind: type[TourRow | ValuesRow],
    note: dict[str, Any] | None,
) -> bool:
    """Store, replace or remove a tour or module values of a fold.

    Args:
        store: The rows.
        fold_id: The fold.
        owner: Its owner.
        kind: Class of the rows: tours, or values of modules.
        note: Plain values; None to remove them.

    Returns:
        False if the fold does not belong to the owner; gallery folds belong to none.
    """
    is_own = (FoldRow.id == fold_id, owned_by(owner), FoldRow.public.is_(False))
    with store.changing() as session:
        if session.scalar(sa.select(FoldRow.id).where(*is_own).with_for_update()) is None:
            return False
        if note is None:
            session.execute(sa.delete(kind).where(kind.fold_id == fold_id))
        else:
            session.merge(kind(fold_id=fold_id, content=note))
        return True


def hand_over_all(store: Store, owner: Owner, heir: Owner) -> int:
    """Transfer all items of an owner to an heir atomically; return the number of folds.

    Afterwards the same uploads create new folds, as with ``change_fold``.
    """
    owned = sa.update(FoldRow).where(owned_by(owner))
    with store.changing() as session:
        session.execute(owned.where(FoldRow.public.is_(False)).values(content_key=None))
        session.execute(owned.values(owner=heir.digest))
        update = sa.update(FoldRow).where(owned_by(owner, FoldRow.maker))
        moved = rows_of(session.execute(update.values(maker=heir.digest)))
        for rows, column in ((PreviewRow, PreviewRow.owner), (MovieRow, MovieRow.token_hash)):
            update = sa.update(rows).where(owned_by(owner, column))
            session.execute(update.values({column: heir.digest}))
    return moved
