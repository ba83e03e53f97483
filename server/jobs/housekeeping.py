"""Housekeeping: deletion of unused folds, derived files, and orphaned files.

Unfinished, pinned and gallery folds stay. Others expire after ``keep_days`` without access. If the
folds of a visitor, or all folds, exceed their limit of disk space, the least recently used ones are
deleted. Derived files (exports, pictures and movies) are deleted before any fold. They count
separately, because every client with the link may request them.

Cancelled folds stay for an hour, because many are folded again with other options. A visitor's last
one keeps its files; the files of the others are limited, so that cancelled uploads do not fill the
disk. Failed gallery folds are deleted once a later fold of the same shape has ended.
"""

from __future__ import annotations

import itertools
import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Final

import sqlalchemy as sa
from sqlalchemy.orm import aliased

from foldback.planner.storage.files import remove_temporary
from foldback.server.limits.disk_space import free_space
from foldback.server.settings import Settings
from foldback.server.store.folds import DAY_S, Store, rows_of
from foldback.server.store.object_store import StorageError
from foldback.server.store.schema import (
    ENDED,
    UNFINISHED_MOVIE_STATUSES,
    FoldRow,
    MovieRow,
    movie_file,
)

MIN_UNUSED_S: Final = 3600.0
"""Time since the last access to a fold within which it is not deleted to make room on the disk, in
s."""
ORPHAN_SWEEP_S: Final = 3600.0
"""Time between two searches for files of folds that are not in the database, in s, to delete
them."""
NAMES_PER_SWEEP: Final = 500
"""Maximum number of folds' directories that one search for files without an entry in the database
checks; the next search continues."""
MIN_ORPHAN_AGE_S: Final = 3600.0
"""Minimum age of files of folds that are not in the database before they are deleted, in s: a new
fold has files before it is entered."""
MIN_DERIVED_AGE_S: Final = 600.0
"""Minimum age of a derived file (an export or a movie) before it may be deleted to make room, in s,
so that the client that requested the file can download it."""
CANCELLED_FOLD_S: Final = 3600.0
"""Time from the last access to a cancelled fold until the fold is deleted, in s."""
MAX_CANCELLED_BYTES: Final = 16 * 2**20
"""Maximum total size of one visitor's cancelled folds, in bytes; beyond it the files of the oldest
ones are deleted early. The newest one always stays."""
MAX_CANCELLED_FOLDS: Final = 32
"""Maximum number of cancelled folds that are stored for one visitor; older ones are deleted."""
DELETION_BATCH_ROWS: Final = 500
"""Maximum number of folds that one database query reads when cancelled or expired folds are
deleted; further queries read the rest."""
log = logging.getLogger("foldback.janitor")
_Unused = sa.Row[str, float, int]
"""Id of a fold, time of the last access, and size of its own files."""
_CANCELLED: Final = (FoldRow.status == "cancelled", FoldRow.pinned.is_(False))
_EXPIRING: Final = (
    FoldRow.status.in_(sorted(ENDED)),
    FoldRow.pinned.is_(False),
    FoldRow.public.is_(False),
)


class Housekeeping:
    """Regular deletion of files and folds. Several workers may sweep at once.

    Args:
        settings: The settings.
        store: Rows and files.
        clock: Clock in seconds since 1970.
    """

    def __init__(
        self, settings: Settings, store: Store, *, clock: Callable[[], float] = time.time
    ) -> None:
        self._settings = settings
        self._store = store
        self._clock = clock
        self._orphans_at = -ORPHAN_SWEEP_S
        self._names: Iterator[str] | None = None
        """Remaining names of the current round through all files; None between rounds."""
        self._suspects: set[str] = set()
        self._new_suspects: set[str] = set()
        """Names without a row in the last round, and in the current one."""

    def sweep(self) -> int:
        """Sweep once; return the number of expired folds."""
        self.remove_cancelled()
        self._make_room()
        removed = self._forget_superseded() + self._expire()
        now = time.monotonic()
        if self._names is not None or now - self._orphans_at >= ORPHAN_SWEEP_S:
            if self._names is None:
                self._orphans_at = now
            self.sweep_orphans()
        return removed

    def remove_cancelled(self) -> None:
        """Delete cancelled folds without access for an hour."""
        self._forget_unused(self._clock() - CANCELLED_FOLD_S, *_CANCELLED)

    def _make_room(self) -> None:
        """Delete derived files if they exceed their limit or the disk is nearly full."""
        settings = self._settings
        lacking = 0
        if settings.storage_bytes is not None:
            with self._store.reading() as session:
                own_bytes, files = session.execute(
                    sa.select(sa.func.sum(FoldRow.bytes), sa.func.sum(FoldRow.derived_bytes))
                ).one()
                movies = session.scalar(sa.select(sa.func.sum(MovieRow.bytes)))
            lacking = (
                int(own_bytes or 0) + int(files or 0) + int(movies or 0) - settings.storage_bytes
            )
        if self._store.folders.storage is None:
            lacking = max(lacking, settings.min_free_disk_bytes - free_space(settings.root))
        if lacking > 0:
            try:
                freed = self._drop_exports(lacking)
                self._drop_movies(lacking - freed)
            except StorageError as error:
                log.warning("storage could not be freed: %s", error)

    def _drop_exports(self, lacking: int) -> int:
        """Delete exports and pictures of the least recently used folds; return their bytes.

        Args:
            lacking: Number of bytes to free.

        Raises:
            StorageError: If the storage does not answer.
        """
        filled = sa.select(FoldRow.id).where(FoldRow.derived_bytes > 0).order_by(FoldRow.seen_at)
        names = self._store.scalars(filled)
        freed = 0
        before = time.time() - MIN_DERIVED_AGE_S
        for fold_id in names:
            if freed >= lacking:
                break
            removed_bytes, left_bytes = self._store.folders.remove_exports(fold_id, before=before)
            if removed_bytes:
                log.info("deleting exports of fold %s", fold_id, extra={"fold": fold_id})
                freed += removed_bytes
            # Several processes may have created the same file, and each of them has counted it.
            self._store.set_derived(fold_id, left_bytes)
        return freed

    def _drop_movies(self, lacking: int) -> None:
        """Delete movies, first those that the folds' owners have not requested.

        Args:
            lacking: Number of bytes to free.

        Raises:
            StorageError: If the storage does not answer.
        """
        finished = MovieRow.status.not_in(UNFINISHED_MOVIE_STATUSES)
        oldest = (
            sa.select(MovieRow.job)
            .join(FoldRow, FoldRow.id == MovieRow.fold_id)
            .where(finished, MovieRow.created_at < time.time() - MIN_DERIVED_AGE_S)
            .order_by(MovieRow.of_owner, FoldRow.seen_at, MovieRow.created_at)
        )
        jobs = self._store.scalars(oldest)
        for job in jobs:
            if lacking <= 0:
                return
            deletion = sa.delete(MovieRow).where(MovieRow.job == job, finished)
            with self._store.changing() as session:
                row = session.execute(deletion.returning(MovieRow.fold_id, MovieRow.bytes)).first()
            if row is not None:
                log.info("deleting a movie of fold %s", row.fold_id, extra={"fold": row.fold_id})
                self._store.folders.remove_movie(row.fold_id, movie_file(job))
                lacking -= row.bytes

    def _forget_superseded(self) -> int:
        """Delete gallery folds that failed by an internal error and were computed again."""
        later = aliased(FoldRow)
        failed = sa.select(FoldRow.id, FoldRow.seen_at).where(
            FoldRow.public,
            FoldRow.status == "failed",
            FoldRow.content_key.is_(None),
            sa.exists().where(
                later.public,
                later.shape == FoldRow.shape,
                later.created_at > FoldRow.created_at,
                later.status.in_(("verified", "failed")),
            ),
        )
        rows = self._store.rows(failed)
        return sum(_forget(self._store, fold_id, seen_at) for fold_id, seen_at in rows)

    def _expire(self) -> int:
        """Delete folds that have expired or exceed the limits of disk space."""
        settings = self._settings
        removed = 0
        if settings.keep_days is not None:
            removed += self._forget_unused(self._clock() - settings.keep_days * DAY_S, *_EXPIRING)
        if settings.storage_bytes is not None:
            removed += self._forget_until(settings.storage_bytes)
        if settings.storage_of_visitor_bytes is not None:
            size = sa.func.sum(FoldRow.bytes)
            beyond = (
                sa.select(FoldRow.visitor)
                .group_by(FoldRow.visitor)
                .having(size > settings.storage_of_visitor_bytes)
            )
            visitors = self._store.scalars(beyond)
            for visitor in visitors:
                removed += self._forget_until(
                    settings.storage_of_visitor_bytes, FoldRow.visitor == visitor
                )
        return removed

    def _forget_unused(self, since: float, *conditions: sa.ColumnElement[bool]) -> int:
        """Delete folds without access since a time; return their number."""
        removed = 0
        for _ in range(20):
            batch = self._unused(since, *conditions)
            removed += sum(_forget(self._store, fold_id, seen_at) for fold_id, seen_at, _ in batch)
            if len(batch) < DELETION_BATCH_ROWS:
                break
        return removed

    def _forget_until(self, limit: int, *whose: sa.ColumnElement[bool]) -> int:
        """Delete the least recently used folds until the rest take at most ``limit`` bytes.

        Returns:
            Number of deleted folds.
        """
        total = int(self._store.scalar(sa.select(sa.func.sum(FoldRow.bytes)).where(*whose)) or 0)
        removed = 0
        unused_since = self._clock() - MIN_UNUSED_S
        while total > limit:
            before = removed
            for fold_id, seen_at, size in self._unused(unused_since, *_EXPIRING, *whose):
                if total > limit and _forget(self._store, fold_id, seen_at):
                    total -= size
                    removed += 1
            if removed == before:
                break
        return removed

    def _unused(self, since: float, *conditions: sa.ColumnElement[bool]) -> Sequence[_Unused]:
        """Return folds without access since a time, least recently used first."""
        return self._store.rows(
            sa.select(FoldRow.id, FoldRow.seen_at, FoldRow.bytes)
            .where(*conditions, FoldRow.seen_at < since)
            .order_by(FoldRow.seen_at)
            .limit(DELETION_BATCH_ROWS)
        )

    def sweep_orphans(self) -> None:
        """Delete temporary files and files of folds without a row; a part of them per call.

        The first call of a round also deletes what interrupted restores have left.

        Files of folds without a row are deleted when two successive rounds find them.
        """
        if self._names is None:
            self._store.discard_staged()
            self._names = self._files()
            self._suspects, self._new_suspects = self._new_suspects, set()
        names = set(itertools.islice(self._names, NAMES_PER_SWEEP))
        if len(names) < NAMES_PER_SWEEP:
            self._names = None
        for name in names:
            for folder in (self._settings.folds_dir, self._settings.work_dir):
                remove_temporary(folder / name, before=time.time() - MIN_ORPHAN_AGE_S)
        orphans = names - set(
            self._store.scalars(sa.select(FoldRow.id).where(FoldRow.id.in_(names)))
        )
        for fold_id in orphans & self._suspects:
            if not (fold_id.isascii() and fold_id.isalnum()):
                continue
            log.info("deleting files of %s, which belong to no fold", fold_id)
            self._store.folders.remove(fold_id)
        self._new_suspects |= orphans - self._suspects

    def _files(self) -> Iterator[str]:
        """Yield the names of folds with old files."""
        folders, settings = self._store.folders, self._settings
        for directory in (settings.folds_dir, settings.work_dir):
            if not directory.is_dir():
                continue
            with os.scandir(directory) as entries:
                for entry in entries:
                    with suppress(OSError):  # another process has just removed it
                        if time.time() - entry.stat().st_mtime > MIN_ORPHAN_AGE_S:
                            yield entry.name
        if folders.storage is not None:
            yield from folders.storage.below("folds")
            yield from folders.storage.below("movies")
        yield from folders.copied()  # copies of folds that another machine may have deleted


def limit_cancelled(store: Store, visitor: str) -> None:
    """Delete cancelled folds of a visitor, or their files, beyond the limits.

    Args:
        store: Rows and files.
        visitor: The visitor.
    """
    newest_first = (
        sa.select(FoldRow.id, FoldRow.seen_at, FoldRow.bytes)
        .where(*_CANCELLED, FoldRow.visitor == visitor)
        .order_by(FoldRow.seen_at.desc())
        .limit(MAX_CANCELLED_FOLDS + DELETION_BATCH_ROWS)
    )
    rows = store.rows(newest_first)
    total = 0
    for k, row in enumerate(rows):
        if k >= MAX_CANCELLED_FOLDS:
            _forget(store, row.id, row.seen_at)
        elif k > 0 and total + row.bytes > MAX_CANCELLED_BYTES:
            _drop_files(store, row)
        else:
            total += row.bytes if k > 0 else 0


def _forget(store: Store, fold_id: str, seen_at: float | None) -> bool:
    """Delete a fold with its files, unless it has changed since its row was read."""
    if not store.expire(fold_id, seen_at):
        return False
    log.info("fold %s expires", fold_id, extra={"fold": fold_id})
    _remove_files(store, fold_id)
    return True


def _drop_files(store: Store, row: _Unused) -> None:
    """Delete the files and movies of a cancelled fold, but not its row."""
    if not row.bytes:
        return
    unchanged = (FoldRow.id == row.id, *_CANCELLED, FoldRow.seen_at == row.seen_at)
    with store.changing() as session:
        emptied = sa.update(FoldRow).where(*unchanged).values(bytes=0, derived_bytes=0)
        swept = rows_of(session.execute(emptied))
        if swept:
            session.execute(sa.delete(MovieRow).where(MovieRow.fold_id == row.id))
    if swept:
        _remove_files(store, row.id)


def _remove_files(store: Store, fold_id: str) -> None:
    try:
        store.folders.remove(fold_id)
    except StorageError as error:  # the search for files without a row finds them later
        log.warning("files of fold %s could not be deleted: %s", fold_id, error)
