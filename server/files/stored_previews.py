"""Kept previews: uploads and reports in the storage, where all web processes find them.

Without a storage there is nothing of this: then one directory is shared by all.
"""

from __future__ import annotations

import json
import logging
import os
import shutil
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

from server.settings import Settings
from server.store.folds import new_id
from server.store.object_store import Storage, StorageError

PREVIEWS_KEY: Final = "previews"
UPLOAD_FILE: Final = "upload.json"
STORED_SWEEP_S: Final = 600.0
"""Minimum time between two deletions of expired previews in the object store, in s. With a larger
value expired previews occupy storage for longer; a smaller value lists the store more often.
Chosen."""
TOUCHES_PER_LIFETIME: Final = 8
"""Number of times within a preview's lifetime that the time of its last access is updated in the
object store. A larger value writes more often; with a smaller one a preview may expire too early
after its last access. Chosen."""
log = logging.getLogger("foldback.web")


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldPreview:
    """A preview that takes room.

    Attributes:
        name: Its id.
        touched: When somebody looked at it last, in seconds of the clock.
        size: Its bytes.
        visitor: Whose upload it is.
        foreign: Bytes of options that strangers asked for, which the owner is not charged for.
    """

    name: str
    touched: float
    size: int
    visitor: str
    foreign: int = 0


def superfluous(
    held: Iterable[HeldPreview],
    settings: Settings,
    *,
    now: float,
) -> list[str]:
    """Return the previews to remove: expired ones, and the oldest of visitors with too many.

    Where all together are too many, the one who holds most loses his own first.

    Args:
        held: All previews.
        settings: Say how much there may be and how old.
        now: Time of the clock.
    """
    oldest_first = sorted(held, key=lambda preview: preview.touched)
    sizes: Counter[str] = Counter()
    counts: Counter[str] = Counter()
    for preview in oldest_first:
        sizes[preview.visitor] += preview.size
        counts[preview.visitor] += 1
    gone: list[str] = []
    kept: dict[str, list[HeldPreview]] = {}

    def go(preview: HeldPreview) -> None:
        gone.append(preview.name)
        sizes[preview.visitor] -= preview.size
        counts[preview.visitor] -= 1

    for preview in oldest_first:
        old = now - preview.touched > settings.preview_keep_s
        too_many = counts[preview.visitor] > settings.most_previews_of_visitor
        if old or too_many or sizes[preview.visitor] > settings.previews_of_visitor_bytes:
            go(preview)
        else:
            kept.setdefault(preview.visitor, []).append(preview)
    left = [preview for previews in kept.values() for preview in previews]
    total_bytes, total = sum(preview.size + preview.foreign for preview in left), len(left)
    while kept and (total_bytes > settings.previews_bytes or total > settings.most_previews):
        weights = sizes if total_bytes > settings.previews_bytes else counts
        most = max(kept, key=lambda name: weights[name])
        oldest = kept[most].pop(0)
        total_bytes, total = total_bytes - oldest.size - oldest.foreign, total - 1
        go(oldest)
        if not kept[most]:
            del kept[most]
    return gone


def noted(about: bytes | None) -> dict[str, Any]:
    """Return the values in ``upload.json``; none if it is missing or damaged."""
    try:
        found = json.loads(about or b"{}")
    except (ValueError, RecursionError):  # whatever computed there wrote it
        return {}
    return cast("dict[str, Any]", found) if isinstance(found, dict) else {}


def visitor_noted(about: bytes | None) -> str:
    """Return the visitor of an upload in ``upload.json``; None of older uploads."""
    return str(noted(about).get("visitor", ""))


class StoredPreviews:
    """See the module's description. Safe to use from many threads.

    Args:
        settings: The settings.
        storage: Object store; None if files stay on this machine.
    """

    def __init__(self, settings: Settings, storage: Storage | None) -> None:
        self._settings = settings
        self._storage = storage
        self._swept = -STORED_SWEEP_S
        self._visitors: dict[str, str] = {}
        """Whose those in the storage are, as far as it was asked for."""

    def keep(self, preview_id: str, directory: Path) -> None:
        """Store an upload; remove its directory if that fails.

        Raises:
            StorageError: When the storage does not answer.
        """
        if self._storage is not None:
            try:
                self._keep(f"{PREVIEWS_KEY}/{preview_id}", directory)
            except StorageError:
                shutil.rmtree(directory, ignore_errors=True)
                raise

    def keep_report(self, place: Path) -> None:
        """Store the report of an upload's options; if that fails, others compute it again."""
        if self._storage is not None:
            try:
                self._keep(f"{PREVIEWS_KEY}/{place.parent.name}/{place.name}", place)
            except StorageError as error:
                log.warning("a preview's report could not be stored: %s", error)

    def fetch(self, preview_id: str, directory: Path) -> bool:
        """Fetch an upload and its reports, whole or not at all; False if there is none.

        Raises:
            StorageError: When the storage does not answer.
        """
        if self._storage is None:
            return False
        aside = directory.with_name(f".{preview_id}.{new_id()}")
        try:
            if not self._storage.fetch(f"{PREVIEWS_KEY}/{preview_id}", aside):
                return False
            if not (aside / UPLOAD_FILE).is_file():  # it is being removed just now
                return False
            with suppress(OSError):  # another request was quicker
                aside.rename(directory)
        finally:
            shutil.rmtree(aside, ignore_errors=True)
        return True

    def there(self, preview_id: str) -> bool:
        """Return True if an upload is stored.

        Raises:
            StorageError: When the storage does not answer.
        """
        if self._storage is None:
            return False
        return self._storage.read(f"{PREVIEWS_KEY}/{preview_id}/{UPLOAD_FILE}") is not None

    def remove(self, preview_id: str) -> None:
        """Remove an upload once other web processes have dropped their copies.

        Raises:
            StorageError: When the storage does not answer.
        """
        if self._storage is not None:
            self._storage.remove(f"{PREVIEWS_KEY}/{preview_id}")

    def fetch_report(self, place: Path) -> None:
        """Fetch the report of an upload's options, if it is stored elsewhere.

        Raises:
            StorageError: When the storage does not answer.
        """
        if self._storage is not None:
            self._storage.fetch(f"{PREVIEWS_KEY}/{place.parent.name}/{place.name}", place)

    def touch(self, directory: Path) -> None:
        """Record from time to time that a preview is used, so that it does not expire."""
        if self._storage is None:
            return
        upload = directory / UPLOAD_FILE
        try:
            if (
                abs(time.time() - upload.stat().st_mtime)
                > self._settings.preview_keep_s / TOUCHES_PER_LIFETIME
            ):
                os.utime(upload)
                self._storage.keep_file(f"{PREVIEWS_KEY}/{directory.name}/{UPLOAD_FILE}", upload)
        except (StorageError, OSError) as error:
            log.warning("a preview's time of use could not be updated: %s", error)

    def sweep_if_due(self) -> None:
        """Sweep, unless that was done recently.

        Raises:
            StorageError: When the storage does not answer.
        """
        now = time.monotonic()
        if now - self._swept >= STORED_SWEEP_S:
            self._swept = now
            self.sweep()

    def sweep(self) -> None:
        """Remove expired previews, and the oldest while there are too many.

        Raises:
            StorageError: When the storage does not answer.
        """
        if self._storage is None:
            return
        ages = self._storage.ages(PREVIEWS_KEY)
        self._visitors = {
            name: visitor
            if (visitor := self._visitors.get(name)) is not None
            else visitor_noted(self._storage.read(f"{PREVIEWS_KEY}/{name}/{UPLOAD_FILE}"))
            for name in ages
        }
        held = [
            HeldPreview(name=name, touched=changed, size=size, visitor=self._visitors[name])
            for name, (changed, size) in ages.items()
        ]
        for name in superfluous(held, self._settings, now=time.time()):
            self._storage.remove(f"{PREVIEWS_KEY}/{name}")

    def _keep(self, key: str, directory: Path) -> None:
        assert self._storage is not None
        try:
            self._storage.keep(key, directory)
        finally:
            self._storage.forget(key)
