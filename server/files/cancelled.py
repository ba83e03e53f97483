"""Cancelled folds: their files stay for a while, since many are folded again in another way.

Without a bound somebody could fill the disk by uploads that he cancels at once. So of one visitor
the last cancelled fold keeps its files, and others only few bytes, all for an hour. A private fold
keeps its row, whose page says what became of it; one of the gallery is forgotten.
"""

from __future__ import annotations

import logging
from typing import Final

import sqlalchemy as sa

from server.store.folds import Store, rows_of
from server.store.object_store import StorageError
from server.store.tables import FoldRow, MovieRow

KEPT_S: Final = 3600.0
"""Seconds from the end of a cancelled fold until its files are removed."""
KEPT_BYTES: Final = 16 * 2**20
"""Bytes of one visitor's cancelled folds that are kept meanwhile, besides the last one's."""
log = logging.getLogger("foldback.janitor")


def sweep_cancelled(store: Store, now: float, *, visitor: str | None = None) -> None:
    """Removes files of cancelled folds, of all visitors or of one; pinned folds keep theirs.

    Args:
        store: Rows and files.
        now: What time it is, in seconds since 1970.
        visitor: Whose folds.
    """
    ended_at = sa.func.coalesce(FoldRow.ended_at, FoldRow.created_at)
    query = (
        sa.select(FoldRow.id, FoldRow.visitor, FoldRow.bytes, FoldRow.public, ended_at)
        .where(
            FoldRow.status == "cancelled",
            FoldRow.pinned.is_(False),
            sa.or_(FoldRow.bytes > 0, FoldRow.public),
        )
        .order_by(ended_at.desc())
    )
    if visitor is not None:
        query = query.where(FoldRow.visitor == visitor)
    with store.reading() as session:
        rows = session.execute(query).all()
    kept: dict[str, int] = {}
    for fold_id, whose, size, public, ended in rows:
        old, last = now - ended > KEPT_S, whose not in kept
        total = kept.setdefault(whose, 0) + (0 if last else size)
        if not old and total <= KEPT_BYTES:
            kept[whose] = total
            continue
        same = sa.and_(FoldRow.id == fold_id, FoldRow.status == "cancelled", ended_at == ended)
        change = (
            sa.delete(FoldRow).where(same)
            if public and old
            else sa.update(FoldRow).where(same).values(bytes=0, derived_bytes=0)
        )
        with store.changing() as session:
            swept = rows_of(session.execute(change))
            if swept:
                session.execute(sa.delete(MovieRow).where(MovieRow.fold_id == fold_id))
        if swept and size:
            log.info("files of cancelled fold %s go", fold_id, extra={"fold": fold_id})
            try:
                store.folders.remove(fold_id)
            except StorageError as error:  # what belongs to no fold is swept another day
                log.warning("files of cancelled fold %s stay: %s", fold_id, error)
