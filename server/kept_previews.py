"""Kept previews: uploads and reports in the storage, where all web processes find them.

Without a storage there is nothing of this: then one directory is shared by all.
"""

from __future__ import annotations

import logging
import os
import shutil
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from server.settings import Settings
from server.storage import Storage, StorageError
from server.store import new_id

ROOT: Final = "previews"
UPLOAD: Final = "upload.json"
SWEEP_EVERY_S: Final = 600.0
TOUCHES: Final = 8
"""How often, while it is kept, it is noted there that somebody looks at a preview."""
log = logging.getLogger("foldback.web")


class KeptPreviews:
    """See the module's description. Safe to use from many threads.

    Args:
        settings: The settings.
        storage: Where files are kept; None when that is on this machine.
    """

    def __init__(self, settings: Settings, storage: Storage | None) -> None:
        self._settings = settings
        self._storage = storage
        self._lock = threading.Lock()
        self._swept = -SWEEP_EVERY_S

    def keep(self, preview_id: str, directory: Path) -> None:
        """Keeps an upload; its directory is gone when that fails.

        Raises:
            StorageError: When the storage does not answer.
        """
        if self._storage is not None:
            try:
                self._keep(f"{ROOT}/{preview_id}", directory)
            except StorageError:
                shutil.rmtree(directory, ignore_errors=True)
                raise

    def keep_report(self, place: Path) -> None:
        """Keeps what came of an upload's wishes; others compute it anew if that fails."""
        if self._storage is not None:
            try:
                self._keep(f"{ROOT}/{place.parent.name}/{place.name}", place)
            except StorageError as error:
                log.warning("a preview's report could not be kept: %s", error)

    def fetch(self, preview_id: str, directory: Path) -> bool:
        """Brings an upload and its reports here, whole or not at all; False when there is none.

        Raises:
            StorageError: When the storage does not answer.
        """
        if self._storage is None:
            return False
        aside = directory.with_name(f".{preview_id}.{new_id()}")
        try:
            if not self._storage.fetch(f"{ROOT}/{preview_id}", aside):
                return False
            if not (aside / UPLOAD).is_file():  # it is being removed just now
                return False
            with suppress(OSError):  # another request was quicker
                aside.rename(directory)
        finally:
            shutil.rmtree(aside, ignore_errors=True)
        return True

    def fetch_report(self, place: Path) -> None:
        """Brings what came of an upload's wishes here, if that is known elsewhere.

        Raises:
            StorageError: When the storage does not answer.
        """
        if self._storage is not None:
            self._storage.fetch(f"{ROOT}/{place.parent.name}/{place.name}", place)

    def touch(self, directory: Path) -> None:
        """Notes now and then that somebody looks at a preview, so that it is kept."""
        if self._storage is None:
            return
        upload = directory / UPLOAD
        try:
            if abs(time.time() - upload.stat().st_mtime) > self._settings.preview_keep_s / TOUCHES:
                os.utime(upload)
                self._storage.keep_file(f"{ROOT}/{directory.name}/{UPLOAD}", upload)
        except (StorageError, OSError) as error:
            log.warning("a preview could not be touched: %s", error)

    def sweep_soon(self) -> None:
        """Sweeps in a thread of its own, unless that was done lately."""
        with self._lock:
            now = time.monotonic()
            if self._storage is None or now - self._swept < SWEEP_EVERY_S:
                return
            self._swept = now
        threading.Thread(target=self._sweep, name="previews", daemon=True).start()

    def sweep(self) -> None:
        """Forgets what is old, and the oldest while there is too much.

        Raises:
            StorageError: When the storage does not answer.
        """
        if self._storage is None:
            return
        now = time.time()
        found = sorted(
            (changed, size, name) for name, (changed, size) in self._storage.ages(ROOT).items()
        )
        total = sum(size for _, size, _ in found)
        for changed, size, name in found:
            old = now - changed > self._settings.preview_keep_s
            if old or total > self._settings.previews_bytes:
                self._storage.remove(f"{ROOT}/{name}")
                total -= size

    def _sweep(self) -> None:
        try:
            self.sweep()
        except (StorageError, RuntimeError) as error:  # the process may be ending
            log.warning("previews could not be swept: %s", error)

    def _keep(self, key: str, directory: Path) -> None:
        assert self._storage is not None
        try:
            self._storage.keep(key, directory)
        finally:
            self._storage.forget(key)
