"""Janitor: forgets folds that nobody looks at any more, and files that belong to nobody.

Folds of the gallery and pinned ones stay, and so do those that are not over. The others go when
nobody has looked at them for ``keep_days``, or, the longest unseen first, when the folds of a
visitor or of all take more than they may; what can be made again goes before. Of the gallery those
go that were cancelled (``server/files/cancelled.py``), and those that failed once there is a later
one.
"""

from __future__ import annotations

import logging
import shutil
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Final

import sqlalchemy as sa
from sqlalchemy.orm import aliased

from planner.files import remove_temporary
from server.files.cancelled import sweep_cancelled
from server.files.derived import count_apart, derived_bytes, drop_derived
from server.settings import Settings
from server.store.folds import DAY_S, Store, seen_of
from server.store.object_store import StorageError
from server.store.tables import ENDED, FoldRow

FRESH_S: Final = 3600.0
"""Seconds since somebody looked at it for which a fold stays, however little room there is."""
ORPHANS_EVERY_S: Final = 3600.0
ORPHAN_AGE_S: Final = 3600.0
"""Seconds that files may be without a row: an upload has files first."""
log = logging.getLogger("foldback.janitor")


class Janitor:
    """See the module's description. Several may sweep at once.

    Args:
        settings: The settings.
        store: Rows and files.
        clock: What time it is.
    """

    def __init__(
        self, settings: Settings, store: Store, *, clock: Callable[[], float] = time.time
    ) -> None:
        self._settings = settings
        self._store = store
        self._clock = clock
        self._counted_apart = False
        self._orphans_at = -ORPHANS_EVERY_S
        self._suspects: set[str] = set()

    def sweep(self) -> int:
        """Sweeps once; how many folds were forgotten."""
        if not self._counted_apart:
            count_apart(self._store)
            self.remove_temporary()
            self._counted_apart = True
        sweep_cancelled(self._store, self._clock())
        self._make_room()
        gone = self._forget_superseded() + self._expire()
        now = time.monotonic()
        if now - self._orphans_at >= ORPHANS_EVERY_S:
            self._orphans_at = now
            self.sweep_orphans()
        return gone

    def _make_room(self) -> None:
        """Drops what can be made again when it takes too much, or the disk is nearly full."""
        settings = self._settings
        lacking = 0
        if settings.storage_bytes is not None:
            with self._store.reading() as session:
                own = int(session.scalar(sa.select(sa.func.sum(FoldRow.bytes))) or 0)
            lacking = own + derived_bytes(self._store) - settings.storage_bytes
        if self._store.folders.storage is None:
            free = shutil.disk_usage(settings.root).free
            lacking = max(lacking, settings.min_free_disk_bytes - free)
        if lacking > 0:
            try:
                drop_derived(self._store, lacking)
            except StorageError as error:
                log.warning("no room could be made: %s", error)

    def _forget_superseded(self) -> int:
        """Forgets folds of the gallery that failed by the service's fault and were done again."""
        later = aliased(FoldRow)
        failed = sa.select(FoldRow.id, seen_of()).where(
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

    def _forget(self, fold_id: str, seen: float) -> bool:
        if not self._store.expire(fold_id, seen):
            return False
        log.info("fold %s expires", fold_id, extra={"fold": fold_id})
        self._store.folders.remove(fold_id)
        return True

    def _expire(self) -> int:
        settings = self._settings
        if settings.keep_days is None and (
            settings.storage_bytes is settings.storage_of_visitor_bytes is None
        ):
            return 0
        with self._store.reading() as session:
            rows = session.execute(
                sa.select(
                    FoldRow.id,
                    FoldRow.visitor,
                    FoldRow.bytes,
                    seen_of(),
                    sa.or_(FoldRow.pinned, FoldRow.public, FoldRow.status.not_in(sorted(ENDED))),
                )
            ).all()
        folds = sorted(
            (seen, fold_id, visitor, size, stays) for fold_id, visitor, size, seen, stays in rows
        )
        gone = 0
        total = sum(size for _, _, _, size, _ in folds)
        of_visitor: dict[str, int] = {}
        for _, _, visitor, size, _ in folds:
            of_visitor[visitor] = of_visitor.get(visitor, 0) + size
        for seen, fold_id, visitor, size, stays in folds:
            unseen = (
                settings.keep_days is not None and self._clock() - seen > settings.keep_days * DAY_S
            )
            too_much = settings.storage_bytes is not None and total > settings.storage_bytes
            too_much_of_visitor = (
                settings.storage_of_visitor_bytes is not None
                and of_visitor[visitor] > settings.storage_of_visitor_bytes
            )
            fresh = self._clock() - seen < FRESH_S
            wanted = stays or not (unseen or (not fresh and (too_much or too_much_of_visitor)))
            if not wanted and self._forget(fold_id, seen):
                total -= size
                of_visitor[visitor] -= size
                gone += 1
        return gone

    def remove_temporary(self) -> None:
        """Remove what killed processes have left half written; once, when a worker starts."""
        for folder in (self._settings.folds_dir, self._settings.work_dir):
            for fold in folder.iterdir() if folder.is_dir() else ():
                remove_temporary(fold, before=time.time() - ORPHAN_AGE_S)

    def sweep_orphans(self) -> None:
        """Removes files of folds that have no row, seen so twice."""
        folders, settings = self._store.folders, self._settings
        found: set[str] = set()
        if folders.storage is not None:
            found |= set(folders.storage.below("folds")) | set(folders.storage.below("movies"))
        for directory in (settings.folds_dir, settings.work_dir):
            for entry in directory.iterdir() if directory.is_dir() else ():
                with suppress(OSError):  # somebody else removes it just now
                    if time.time() - entry.stat().st_mtime > ORPHAN_AGE_S:
                        found.add(entry.name)
        found |= folders.copied()  # of folds that were forgotten on another machine
        orphans = found - self._known(found)
        for fold_id in orphans & self._suspects:
            if not (fold_id.isascii() and fold_id.isalnum()):
                continue
            log.info("files of %s belong to no fold", fold_id)
            folders.remove(fold_id)
        self._suspects = orphans

    def _known(self, names: Iterable[str]) -> set[str]:
        wanted = sorted(names)
        known: set[str] = set()
        with self._store.reading() as session:
            for first in range(0, len(wanted), 500):
                some = wanted[first : first + 500]
                known |= set(session.scalars(sa.select(FoldRow.id).where(FoldRow.id.in_(some))))
        return known
