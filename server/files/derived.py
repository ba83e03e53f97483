"""Derived files: exports, pictures and movies of folds, which can be computed again.

They count apart from the folds' own files, since anybody with a link may ask for them: none of them
makes a fold expire, and when room is short they go before any fold does, those that the owner of a
fold has asked for last.
"""

from __future__ import annotations

import logging
import time
from contextlib import suppress
from typing import Final

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from server.store.fold_files import DERIVED_DIRS, EXPORTS_DIR, size_of
from server.store.folds import Store
from server.store.tables import (
    ENDED,
    UNFINISHED_MOVIE_STATUSES,
    CounterRow,
    FoldRow,
    MovieRow,
    movie_file,
)

MIN_DERIVED_AGE_S: Final = 600.0
"""Minimum age of a derived file (an export or a movie) before it may be deleted to make room, in s,
so that the client that requested the file can download it. A larger value may leave the disk full
for longer. Chosen."""
COUNTED_FLAG: Final = "counted_apart"
"""Name of the database row which records that the derived files of earlier versions have been
counted separately from the folds' own files; the count happens only once."""
log = logging.getLogger("foldback.janitor")


def derived_bytes(store: Store) -> int:
    """Return the size of all derived files."""
    with store.reading() as session:
        files = session.scalar(sa.select(sa.func.sum(FoldRow.derived_bytes))) or 0
        movies = session.scalar(sa.select(sa.func.sum(MovieRow.bytes))) or 0
    return int(files) + int(movies)


def count_apart(store: Store) -> None:
    """Count files made of folds apart where an earlier version counted them as the folds' own.

    Once for all: a note among the counters says that it is done.
    """
    with store.reading() as session:
        done = session.get(CounterRow, COUNTED_FLAG) is not None
    if done or store.folders.storage is not None:
        return
    uncounted = (FoldRow.derived_bytes == 0, FoldRow.status.in_(sorted(ENDED)))
    with store.reading() as session:
        names = session.scalars(sa.select(FoldRow.id).where(*uncounted)).all()
    for fold_id in names:
        place = store.folders.place(fold_id)
        if not (made := size_of(place / EXPORTS_DIR)):
            continue
        own = size_of(place, but=DERIVED_DIRS)
        with store.changing() as session:
            session.execute(
                sa.update(FoldRow)
                .where(FoldRow.id == fold_id, *uncounted)
                .values(bytes=own, derived_bytes=made)
            )
    with suppress(IntegrityError), store.changing() as session:  # another worker was quicker
        session.add(CounterRow(name=COUNTED_FLAG, value=1))


def drop_derived(store: Store, lacking: int) -> int:
    """Remove derived files of the least recently used folds until there is room.

    Args:
        store: Rows and files.
        lacking: Bytes to free.

    Returns:
        How many did.

    Raises:
        StorageError: When the storage does not answer.
    """
    before = time.time() - MIN_DERIVED_AGE_S
    with store.reading() as session:
        filled = session.scalars(
            sa.select(FoldRow.id).where(FoldRow.derived_bytes > 0).order_by(FoldRow.seen_at)
        ).all()
        movies = session.execute(
            sa.select(MovieRow.job)
            .join(FoldRow, FoldRow.id == MovieRow.fold_id)
            .where(MovieRow.status.not_in(UNFINISHED_MOVIE_STATUSES), MovieRow.created_at < before)
            .order_by(MovieRow.of_owner, FoldRow.seen_at, MovieRow.created_at)
        ).scalars()
        jobs = list(movies)
    freed = 0
    for fold_id in filled:
        if freed >= lacking:
            return freed
        gone, left = store.folders.remove_exports(fold_id, before=before)
        if gone:
            log.info("deleting exports and pictures of fold %s", fold_id, extra={"fold": fold_id})
            freed += gone
        # Several processes may have made the same file, each of which has counted it.
        store.set_derived(fold_id, left)
    for job in jobs:
        if freed >= lacking:
            return freed
        freed += _drop_movie(store, job)
    return freed


def _drop_movie(store: Store, job: str) -> int:
    gone = sa.delete(MovieRow).where(
        MovieRow.job == job, MovieRow.status.not_in(UNFINISHED_MOVIE_STATUSES)
    )
    with store.changing() as session:
        row = session.execute(gone.returning(MovieRow.fold_id, MovieRow.bytes)).first()
    if row is None:
        return 0
    log.info("deleting a movie of fold %s", row.fold_id, extra={"fold": row.fold_id})
    store.folders.remove_movie(row.fold_id, movie_file(job))
    return row.bytes
