"""Cancelled folds: they stay for a while, since many are folded again in another way.

Without a bound a visitor could fill the disk by uploads that are cancelled at once, and the tables
by their rows. So of one visitor the last cancelled fold keeps its files, others only few bytes, and
only the latest rows stay. All of them go an hour after the last look at them. Pinned folds stay.
"""

from __future__ import annotations

import logging
from typing import Final

import sqlalchemy as sa

from server.store.folds import Store, rows_of
from server.store.object_store import StorageError
from server.store.tables import FoldRow, MovieRow

CANCELLED_FOLD_S: Final = 3600.0
"""Time from the last access to a cancelled fold until the fold is deleted, in s. A larger value
occupies the disk for longer. Chosen."""
MAX_CANCELLED_BYTES: Final = 16 * 2**20
"""Maximum total size of one visitor's cancelled folds, in bytes; beyond it the files of the oldest
ones are deleted early. The newest one always stays. A larger value lets visitors occupy more of the
disk. Chosen."""
MAX_CANCELLED_FOLDS: Final = 32
"""Maximum number of cancelled folds that are stored for one visitor; older ones are deleted. A
larger value makes each cancellation slower. Chosen."""
DELETION_BATCH_ROWS: Final = 500
"""Maximum number of rows of the table of folds that one database query reads when cancelled or
expired folds are deleted. A larger value takes more memory; a smaller one needs more queries.
Chosen."""
MAX_DELETION_BATCHES: Final = 20
"""Maximum number of batches, of up to ``DELETION_BATCH_ROWS`` folds each, that one regular clean-up
deletes of cancelled folds, and again of expired ones; the next one continues. A larger value delays
the worker's other duties. Chosen."""
log = logging.getLogger("foldback.janitor")
_Row = sa.Row[str, int, float | None]
_CANCELLED: Final = (FoldRow.status == "cancelled", FoldRow.pinned.is_(False))


def sweep_cancelled(store: Store, now: float) -> None:
    """Remove cancelled folds that nobody has looked at for an hour, with their files.

    Args:
        store: Rows and files.
        now: Time in seconds since 1970.
    """
    old = (
        sa.select(FoldRow.id, FoldRow.bytes, FoldRow.seen_at)
        .where(*_CANCELLED, FoldRow.seen_at < now - CANCELLED_FOLD_S)
        .order_by(FoldRow.seen_at)
        .limit(DELETION_BATCH_ROWS)
    )
    for _ in range(MAX_DELETION_BATCHES):
        with store.reading() as session:
            rows = session.execute(old).all()
        for row in rows:
            _remove(store, row)
        if len(rows) < DELETION_BATCH_ROWS:
            return


def sweep_cancelled_of(store: Store, visitor: str) -> None:
    """Remove what a visitor's cancelled folds take beyond the bounds.

    Args:
        store: Rows and files.
        visitor: The visitor.
    """
    newest_first = (
        sa.select(FoldRow.id, FoldRow.bytes, FoldRow.seen_at)
        .where(*_CANCELLED, FoldRow.visitor == visitor)
        .order_by(FoldRow.seen_at.desc())
        .limit(MAX_CANCELLED_FOLDS + DELETION_BATCH_ROWS)
    )
    with store.reading() as session:
        rows = session.execute(newest_first).all()
    total = 0
    for k, row in enumerate(rows):
        if k >= MAX_CANCELLED_FOLDS:
            _remove(store, row)
        elif k > 0 and total + row.bytes > MAX_CANCELLED_BYTES:
            _drop_files(store, row)
        else:
            total += row.bytes if k > 0 else 0


def _remove(store: Store, row: _Row) -> None:
    """Remove a fold, unless it has changed since its row was read."""
    with store.changing() as session:
        removed = rows_of(session.execute(sa.delete(FoldRow).where(*_same(row))))
    if removed:
        _remove_files(store, row.id)


def _drop_files(store: Store, row: _Row) -> None:
    """Remove the files and movies of a fold, but not its row."""
    if not row.bytes:
        return
    with store.changing() as session:
        swept = rows_of(
            session.execute(sa.update(FoldRow).where(*_same(row)).values(bytes=0, derived_bytes=0))
        )
        if swept:
            session.execute(sa.delete(MovieRow).where(MovieRow.fold_id == row.id))
    if swept:
        _remove_files(store, row.id)


def _same(row: _Row) -> tuple[sa.ColumnElement[bool], ...]:
    return (FoldRow.id == row.id, *_CANCELLED, FoldRow.seen_at == row.seen_at)


def _remove_files(store: Store, fold_id: str) -> None:
    log.info("deleting the files of cancelled fold %s", fold_id, extra={"fold": fold_id})
    try:
        store.folders.remove(fold_id)
    except StorageError as error:  # what belongs to no fold is swept another day
        log.warning("files of cancelled fold %s could not be deleted: %s", fold_id, error)
