"""Sweeper: forgets folds that nobody looks at any more, and files that belong to nobody.

Folds of the gallery and pinned ones stay, and so do those that are not over. The others go when
nobody has looked at them for ``keep_days``, or, the longest unseen first, when the folds of a
visitor or of all take more than they may.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Final

import sqlalchemy as sa

from server.database import ENDED, FoldRow
from server.settings import Settings
from server.store import Store, seen_of

DAY_S: Final = 86400.0
FRESH_S: Final = 3600.0
"""Whatever room there is, what somebody has looked at since stays."""
ORPHANS_EVERY_S: Final = 3600.0
ORPHAN_AGE_S: Final = 3600.0
"""An upload that is being accepted has files before it has a row."""
log = logging.getLogger("foldback.sweeper")


class Sweeper:
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
        self._orphans_at = -ORPHANS_EVERY_S
        self._suspects: set[str] = set()

    def sweep(self) -> int:
        """Sweeps once; how many folds were forgotten."""
        gone = self._expire()
        now = time.monotonic()
        if now - self._orphans_at >= ORPHANS_EVERY_S:
            self._orphans_at = now
            self.sweep_orphans()
        return gone

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
            if not wanted and self._store.expire(fold_id, seen):
                log.info("fold %s expires", fold_id, extra={"fold": fold_id})
                self._store.folders.remove(fold_id)
                total -= size
                of_visitor[visitor] -= size
                gone += 1
        return gone

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
