"""Previews: uploads before folding, stored until they expire or the disk space is needed.

The rows contain their visitors and sizes. Each upload has a directory, with a subdirectory for each
set of options: these options (``request.json``) and the result (``report.json``). With an object
store the directories are copies, which all web processes fetch from there.
"""

from __future__ import annotations

import logging
import os
import shutil
import threading
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError, SQLAlchemyError

from foldback.planner.storage.file_names import INPUT
from foldback.server.errors import NoSuch, not_stored
from foldback.server.settings import Settings
from foldback.server.store.folds import Store, new_id
from foldback.server.store.object_store import StorageError
from foldback.server.store.owner import Owner, owned_by
from foldback.server.store.schema import PreviewRow, ReportRow

PREVIEWS_KEY: Final = "previews"
SWEEPING_THREAD: Final = "preview-sweep"
STORED_SWEEP_S: Final = 600.0
"""Minimum time between two searches of the object store for files of previews that are not in the
database, in s, to delete them."""
MIN_LOST_AGE_S: Final = 600.0
"""Age up to which a preview whose files are missing, and files that a request may still be
fetching, are not deleted, in s."""
MAX_PROTECTED_UPLOADS: Final = 4
"""Maximum number of one visitor's newest uploads that are not deleted to make room on the disk
while they are being read."""
log = logging.getLogger("foldback.service")


class NoSuchPreviewError(NoSuch):
    """There is no preview with this id, or it has expired."""

    def __init__(self, preview_id: str) -> None:
        super().__init__(
            "no-such-preview", "This preview does not exist or has expired; send the file again."
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PreviewSize:
    """Size of a stored preview.

    Attributes:
        id: Id of the preview.
        visitor: Visitor that sent the upload.
        seen_at: Time of the last access, s since 1970.
        own_bytes: Size of the upload and of the reports that its visitor requested, bytes.
        foreign: Size of the reports that others requested, bytes.
        protected: True if a sweep must not delete it.
    """

    id: str
    visitor: str
    seen_at: float
    own_bytes: int
    foreign: int = 0
    protected: bool = False


class Previews:
    """Stored previews. Safe for use by several threads.

    Args:
        settings: The settings.
        store: The rows of the service, and its object store.
    """

    def __init__(self, settings: Settings, store: Store) -> None:
        self._settings = settings
        self._store = store
        self._storage = store.folders.storage
        self._root = settings.previews_dir
        if not settings.read_only:
            self._root.mkdir(parents=True, exist_ok=True)
        self._sweep_bytes = min(16 * 2**20, settings.previews_bytes // 8)
        self._written = 0
        self._searched = -STORED_SWEEP_S
        self._sweep_due = threading.Event()
        self._closed = False

    def close(self) -> None:
        """End the sweeps."""
        self._closed = True
        self._sweep_due.set()

    # Uploads

    def add(self, row: PreviewRow, directory: Path) -> None:
        """Add an upload and move its directory into place.

        Raises:
            NoRoom: If the disk is full.
            StorageError: If the storage does not answer.
        """
        row.bytes = blocks_of(directory)
        with self._store.changing() as session:
            session.add(row)
        try:
            os.rename(directory, self._root / row.id)
            self._keep(row.id)
        except BaseException as error:
            self._forget(PreviewRow.id == row.id)
            if isinstance(error, OSError):
                raise not_stored("upload", error) from error
            raise
        self._note_written(row.bytes)

    def row(self, preview_id: str) -> PreviewRow:
        """Return the row of a preview; ids are checked before they become a path.

        Raises:
            NoSuchPreviewError: If there is none.
        """
        row = self._store.get(PreviewRow, preview_id)
        if row is None:
            raise NoSuchPreviewError(preview_id)
        return row

    def directory(self, preview_id: str) -> Path:
        """Return the directory of an upload.

        Raises:
            NoSuchPreviewError: If there is none.
            StorageError: If it is stored elsewhere and the storage does not answer.
        """
        directory = self._root / self.row(preview_id).id
        if not (directory / INPUT).is_file():
            self._fetch_upload(directory)
        if not (directory / INPUT).is_file():
            raise NoSuchPreviewError(preview_id)
        return directory

    def touch(self, row: PreviewRow) -> None:
        """Record an access to a preview, at a coarse resolution; errors are ignored."""
        now = time.time()
        most_s = min(60.0, self._settings.preview_keep_s / 8)
        if abs(now - row.seen_at) > most_s:
            update = sa.update(PreviewRow).where(PreviewRow.id == row.id).values(seen_at=now)
            with suppress(SQLAlchemyError):
                self._store.change(update)

    # Reports

    def place(self, preview_id: str, key: str) -> Path:
        """Return the directory for an upload's report with some options, which may be missing.

        Raises:
            NoSuchPreviewError: If there is no such upload.
            StorageError: If it is stored elsewhere and the storage does not answer.
        """
        place = self.directory(preview_id) / key
        if self._storage is not None and not (place / "report.json").is_file():
            self._storage.fetch(f"{PREVIEWS_KEY}/{preview_id}/{key}", place)
        return place

    def reports(self, preview_id: str, *, foreign: bool) -> int:
        """Return the number of an upload's reports requested by others, or by its visitor."""
        count = sa.select(sa.func.count()).where(
            ReportRow.preview_id == preview_id, ReportRow.foreign.is_(foreign)
        )
        return self._store.scalar(count) or 0

    def keep_report(self, place: Path, *, foreign: bool) -> None:
        """Store the files in the directory of a report.

        If the storage does not answer, other processes compute the report again.

        Args:
            place: The directory.
            foreign: True if a visitor other than the uploader requested the report.
        """
        preview_id, key, size = place.parent.name, place.name, blocks_of(place)
        row = ReportRow(preview_id=preview_id, key=key, foreign=foreign, bytes=size)
        with suppress(IntegrityError), self._store.changing() as session:
            session.merge(row)
        try:
            self._keep(f"{preview_id}/{key}")
        except StorageError as error:
            log.warning("a preview's report could not be stored: %s", error)
        self._note_written(size)

    # Lists of owners

    def note_view(self, preview_id: str, owner: Owner, view: dict[str, Any]) -> None:
        """Record an owner's view of its own preview; errors of the database are ignored.

        Args:
            preview_id: The preview.
            owner: Its owner.
            view: Columns of ``PreviewRow`` that describe the viewed shape and options.
        """
        update = sa.update(PreviewRow).where(
            PreviewRow.id == preview_id, owned_by(owner, PreviewRow.owner)
        )
        with suppress(SQLAlchemyError):
            self._store.change(update.values(**view, seen_at=time.time()))

    def owned(self, owner: Owner) -> Sequence[PreviewRow]:
        """Return the previews that an owner has viewed, last viewed first."""
        query = (
            sa.select(PreviewRow)
            .where(owned_by(owner, PreviewRow.owner), PreviewRow.key != "")
            .where(PreviewRow.seen_at > time.time() - self._settings.preview_keep_s)
            .order_by(PreviewRow.seen_at.desc(), PreviewRow.id)
            .limit(50)
        )
        return self._store.scalars(query)

    def remove(self, preview_id: str, owner: Owner) -> bool:
        """Delete an owner's preview; return False if it is not the owner's.

        The next sweep deletes its files.
        """
        was_deleted = self._forget(PreviewRow.id == preview_id, owned_by(owner, PreviewRow.owner))
        if was_deleted:
            self._searched = -STORED_SWEEP_S
            self._sweep_due.set()
        return was_deleted

    # Sweeps

    def start_sweeping(self) -> None:
        """Start a thread that sweeps periodically, and after many bytes were written."""
        threading.Thread(target=self._sweep_when_due, name=SWEEPING_THREAD, daemon=True).start()

    def sweep(self) -> None:
        """Delete expired and excess previews, and files without a preview.

        Raises:
            OSError: If the directory cannot be read.
            SQLAlchemyError: If the database does not answer.
            StorageError: If the storage does not answer.
        """
        for preview in superfluous(self._sizes(), self._settings, now=time.time()):
            unused = (PreviewRow.id == preview.id, PreviewRow.seen_at == preview.seen_at)
            if self._forget(*unused) and self._storage is not None:
                self._storage.remove(f"{PREVIEWS_KEY}/{preview.id}")
        stored = [entry.name for entry in os.scandir(self._root) if _is_settled(entry)]
        for name in set(stored) - self._ids():
            shutil.rmtree(self._root / name, ignore_errors=True)
        if self._storage is not None:
            now = time.monotonic()
            if now - self._searched < STORED_SWEEP_S:
                return
            self._searched = now
            stored = self._storage.below(PREVIEWS_KEY)
            for name in set(stored) - self._ids():
                self._storage.remove(f"{PREVIEWS_KEY}/{name}")
        for lost in self._ids(before=time.time() - MIN_LOST_AGE_S) - set(stored):
            self._forget(PreviewRow.id == lost)

    def _sweep_when_due(self) -> None:
        while not self._closed:
            self._sweep_due.clear()
            self._written = 0
            try:
                self.sweep()
            except (OSError, StorageError, SQLAlchemyError) as error:
                log.warning("old previews could not be deleted: %s", error)
            self._sweep_due.wait(60.0)

    def _sizes(self) -> list[PreviewSize]:
        """Return the sizes of all previews, newest first."""
        own_bytes, foreign = (
            sa.func.coalesce(
                sa.func.sum(ReportRow.bytes).filter(ReportRow.foreign.is_(of_others)), 0
            )
            for of_others in (False, True)
        )
        query = (
            sa.select(PreviewRow, own_bytes, foreign, sa.func.count(ReportRow.key))
            .outerjoin(ReportRow, ReportRow.preview_id == PreviewRow.id)
            .group_by(PreviewRow.id)
            .order_by(PreviewRow.created_at.desc())
        )
        rows = self._store.rows(query)
        sizes: list[PreviewSize] = []
        unread: Counter[str] = Counter()
        since = time.time() - 60.0  # a process may still be reading it
        for row, of_visitor, of_others, reports in rows:
            being_read = reports == 0 and row.created_at > since
            unread[row.visitor] += being_read
            sizes.append(
                PreviewSize(
                    id=row.id,
                    visitor=row.visitor,
                    seen_at=row.seen_at,
                    own_bytes=row.bytes + int(of_visitor),
                    foreign=int(of_others),
                    protected=being_read and unread[row.visitor] <= MAX_PROTECTED_UPLOADS,
                )
            )
        return sizes

    def _ids(self, *, before: float | None = None) -> set[str]:
        """Return the ids of all previews, or of those created before a time."""
        query = sa.select(PreviewRow.id)
        if before is not None:
            query = query.where(PreviewRow.created_at < before)
        return set(self._store.scalars(query))

    def _forget(self, *conditions: sa.ColumnElement[bool]) -> bool:
        """Delete the row of a preview; return True if there was one."""
        return bool(self._store.change(sa.delete(PreviewRow).where(*conditions)))

    def _note_written(self, size: int) -> None:
        self._written += size  # a race with another thread at most delays a sweep
        if self._written >= self._sweep_bytes:
            self._sweep_due.set()

    def _keep(self, name: str) -> None:
        """Copy a directory to the object store, if there is one."""
        if self._storage is not None:
            key = f"{PREVIEWS_KEY}/{name}"
            try:
                self._storage.keep(key, self._root / name)
            finally:
                self._storage.forget(key)

    def _fetch_upload(self, directory: Path) -> None:
        """Fetch an upload and its reports from the object store atomically."""
        if self._storage is None:
            return
        hidden_dir = directory.with_name(f".{directory.name}.{new_id()}")
        try:
            if self._storage.fetch(f"{PREVIEWS_KEY}/{directory.name}", hidden_dir):
                with suppress(OSError):  # another request was faster
                    hidden_dir.rename(directory)
        finally:
            shutil.rmtree(hidden_dir, ignore_errors=True)


def superfluous(
    previews: Iterable[PreviewSize], settings: Settings, *, now: float
) -> list[PreviewSize]:
    """Return the previews to delete: expired ones, and the oldest ones of visitors above a limit.

    If all together exceed a limit, the visitor with the most loses the oldest ones first.

    Args:
        previews: All previews.
        settings: Settings with the limits.
        now: Current time, s since 1970.
    """
    oldest_first = sorted(previews, key=lambda preview: preview.seen_at)
    sizes: Counter[str] = Counter()
    counts: Counter[str] = Counter()
    for preview in oldest_first:
        sizes[preview.visitor] += preview.own_bytes
        counts[preview.visitor] += 1
    deleted: list[PreviewSize] = []
    kept_sizes: dict[str, list[PreviewSize]] = {}

    def go(preview: PreviewSize) -> None:
        deleted.append(preview)
        sizes[preview.visitor] -= preview.own_bytes
        counts[preview.visitor] -= 1

    for preview in oldest_first:
        old = now - preview.seen_at > settings.preview_keep_s
        too_many = counts[preview.visitor] > settings.most_previews_of_visitor
        if old or too_many or sizes[preview.visitor] > settings.previews_of_visitor_bytes:
            go(preview)
        else:
            kept_sizes.setdefault(preview.visitor, []).append(preview)
    total = sum(map(len, kept_sizes.values()))
    total_bytes = sum(
        size.own_bytes + size.foreign for previews in kept_sizes.values() for size in previews
    )
    while kept_sizes and (total_bytes > settings.previews_bytes or total > settings.most_previews):
        weights = sizes if total_bytes > settings.previews_bytes else counts
        heaviest = max(kept_sizes, key=lambda name: weights[name])
        oldest = kept_sizes[heaviest].pop(0)
        total_bytes, total = total_bytes - oldest.own_bytes - oldest.foreign, total - 1
        go(oldest)
        if not kept_sizes[heaviest]:
            del kept_sizes[heaviest]
    return [preview for preview in deleted if not preview.protected]


def blocks_of(directory: Path) -> int:
    """Return the size of the disk blocks of a directory and its files, in bytes."""
    paths = (directory, *directory.rglob("*"))
    return sum(path.lstat().st_blocks for path in paths) * 512  # POSIX counts blocks of 512 bytes


def _is_settled(entry: os.DirEntry[str]) -> bool:
    """Return False for a directory that is just being fetched."""
    return not entry.name.startswith(".") or entry.stat().st_mtime < time.time() - MIN_LOST_AGE_S
