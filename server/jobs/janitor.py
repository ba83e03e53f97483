"""Janitor: removes unused folds, and files without a fold.

Folds of the gallery and pinned ones stay, and so do those that are not over. The others go when
nobody has looked at them for ``keep_days``, or, the longest unseen first, when the folds of a
visitor or of all take more than they may; what can be made again goes before. Of the gallery those
go that were cancelled (``server/files/cancelled.py``), and those that failed once there is a later
one.
"""

from __future__ import annotations

import itertools
import logging
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from typing import Final

import sqlalchemy as sa
from sqlalchemy.orm import aliased

from planner.files import remove_temporary
from server.files.cancelled import DELETION_BATCH_ROWS, MAX_DELETION_BATCHES, sweep_cancelled
from server.files.derived import count_apart, derived_bytes, drop_derived
from server.limits.disk_space import free_space
from server.settings import Settings
from server.store.folds import DAY_S, Store
from server.store.object_store import StorageError
from server.store.tables import ENDED, FoldRow

MIN_UNUSED_S: Final = 3600.0
"""Time since the last access to a fold within which it is not deleted to make room on the disk, in
s. A larger value may leave the disk full; a smaller one deletes folds that are still in use.
Chosen."""
ORPHAN_SWEEP_S: Final = 3600.0
"""Time between two searches for folds' files that belong to no row of the database, in s. A larger
value leaves such files on the disk for longer. Chosen."""
NAMES_PER_SWEEP: Final = 500
"""Maximum number of folds whose files one sweep compares with the database; later sweeps continue.
A larger value delays the worker's other duties. Chosen."""
MIN_ORPHAN_AGE_S: Final = 3600.0
"""Minimum age of files that belong to no row of the database before they are deleted, in s: a new
fold has files before it has a row. A smaller value may delete new folds; a larger one occupies the
disk for longer. Chosen."""
log = logging.getLogger("foldback.janitor")


class Janitor:
    """See the module's description. Several may sweep at once.

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
        self._counted_apart = False
        self._orphans_at = -ORPHAN_SWEEP_S
        self._names: Iterator[str] | None = None
        """Rest of the round through all files; None if there is none under way."""
        self._suspects: set[str] = set()
        self._found: set[str] = set()
        """Files without a row in the last round, and in this one."""

    def sweep(self) -> int:
        """Sweep once; return the number of removed folds."""
        if not self._counted_apart:
            count_apart(self._store)
            self._counted_apart = True
        sweep_cancelled(self._store, self._clock())
        self._make_room()
        gone = self._forget_superseded() + self._expire()
        now = time.monotonic()
        if self._names is not None or now - self._orphans_at >= ORPHAN_SWEEP_S:
            if self._names is None:
                self._orphans_at = now
            self.sweep_orphans()
        return gone

    def _make_room(self) -> None:
        """Remove derived files if they exceed their limit or the disk is nearly full."""
        settings = self._settings
        lacking = 0
        if settings.storage_bytes is not None:
            with self._store.reading() as session:
                own = int(session.scalar(sa.select(sa.func.sum(FoldRow.bytes))) or 0)
            lacking = own + derived_bytes(self._store) - settings.storage_bytes
        if self._store.folders.storage is None:
            lacking = max(lacking, settings.min_free_disk_bytes - free_space(settings.root))
        if lacking > 0:
            try:
                drop_derived(self._store, lacking)
            except StorageError as error:
                log.warning("no storage could be freed: %s", error)

    def _forget_superseded(self) -> int:
        """Remove gallery folds that failed through the service's fault and were repeated."""
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
        with self._store.reading() as session:
            rows = session.execute(failed).all()
        return sum(self._forget(fold_id, seen) for fold_id, seen in rows)

    def _forget(self, fold_id: str, seen: float | None) -> bool:
        if not self._store.expire(fold_id, seen):
            return False
        log.info("fold %s expires", fold_id, extra={"fold": fold_id})
        self._store.folders.remove(fold_id)
        return True

    def _expire(self) -> int:
        """Forget folds that are unseen for too long, or that there is no room for."""
        settings = self._settings
        gone = 0
        if settings.keep_days is not None:
            gone += self._forget_unseen(self._clock() - settings.keep_days * DAY_S)
        if settings.storage_bytes is not None:
            gone += self._forget_until(settings.storage_bytes)
        if settings.storage_of_visitor_bytes is not None:
            size = sa.func.sum(FoldRow.bytes)
            beyond = (
                sa.select(FoldRow.visitor)
                .group_by(FoldRow.visitor)
                .having(size > settings.storage_of_visitor_bytes)
            )
            with self._store.reading() as session:
                visitors = session.scalars(beyond).all()
            for visitor in visitors:
                gone += self._forget_until(
                    settings.storage_of_visitor_bytes, FoldRow.visitor == visitor
                )
        return gone

    def _forget_unseen(self, since: float) -> int:
        """Forget folds that nobody has looked at since then; the number of them."""
        gone = 0
        for _ in range(MAX_DELETION_BATCHES):
            batch = self._oldest(since)
            gone += sum(self._forget(fold_id, seen) for fold_id, seen, _ in batch)
            if len(batch) < DELETION_BATCH_ROWS:
                break
        return gone

    def _forget_until(self, limit: int, *whose: sa.ColumnElement[bool]) -> int:
        """Forget folds, the longest unseen first, until the others take at most so many bytes.

        Returns:
            Number of folds that were forgotten.
        """
        with self._store.reading() as session:
            total = int(session.scalar(sa.select(sa.func.sum(FoldRow.bytes)).where(*whose)) or 0)
        gone = 0
        while total > limit:
            before = gone
            for fold_id, seen, size in self._oldest(self._clock() - MIN_UNUSED_S, *whose):
                if total > limit and self._forget(fold_id, seen):
                    total -= size
                    gone += 1
            if gone == before:
                break
        return gone

    def _oldest(
        self, since: float, *whose: sa.ColumnElement[bool]
    ) -> Sequence[sa.Row[str, float | None, int]]:
        """Return the longest unseen folds that may go: their ids, times and bytes."""
        with self._store.reading() as session:
            return session.execute(
                sa.select(FoldRow.id, FoldRow.seen_at, FoldRow.bytes)
                .where(
                    FoldRow.status.in_(sorted(ENDED)),
                    FoldRow.seen_at < since,
                    FoldRow.pinned.is_(False),
                    FoldRow.public.is_(False),
                    *whose,
                )
                .order_by(FoldRow.seen_at)
                .limit(DELETION_BATCH_ROWS)
            ).all()

    def sweep_orphans(self) -> None:
        """Remove half-written files, and files of folds that have no row; a part of all at a time.

        What is found so in one round goes when it is found again in the next one.
        """
        if self._names is None:
            self._names = self._files()
            self._suspects, self._found = self._found, set()
        names = set(itertools.islice(self._names, NAMES_PER_SWEEP))
        if len(names) < NAMES_PER_SWEEP:
            self._names = None
        for name in names:
            for folder in (self._settings.folds_dir, self._settings.work_dir):
                remove_temporary(folder / name, before=time.time() - MIN_ORPHAN_AGE_S)
        orphans = names - self._known(names)
        for fold_id in orphans & self._suspects:
            if not (fold_id.isascii() and fold_id.isalnum()):
                continue
            log.info("deleting files of %s, which belong to no fold", fold_id)
            self._store.folders.remove(fold_id)
        self._found |= orphans - self._suspects

    def _files(self) -> Iterator[str]:
        """Yield the names of the folds that there are old files of."""
        folders, settings = self._store.folders, self._settings
        for directory in (settings.folds_dir, settings.work_dir):
            if not directory.is_dir():
                continue
            with os.scandir(directory) as entries:
                for entry in entries:
                    with suppress(OSError):  # somebody else removes it just now
                        if time.time() - entry.stat().st_mtime > MIN_ORPHAN_AGE_S:
                            yield entry.name
        if folders.storage is not None:
            yield from folders.storage.below("folds")
            yield from folders.storage.below("movies")
        yield from folders.copied()  # of folds that were forgotten on another machine

    def _known(self, names: Iterable[str]) -> set[str]:
        wanted = sorted(names)
        known: set[str] = set()
        with self._store.reading() as session:
            for first in range(0, len(wanted), 500):
                some = wanted[first : first + 500]
                known |= set(session.scalars(sa.select(FoldRow.id).where(FoldRow.id.in_(some))))
        return known
