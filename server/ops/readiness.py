"""Readiness: state of the parts that a process needs to accept folds."""

from __future__ import annotations

import contextlib
import logging
import os
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from sqlalchemy.exc import SQLAlchemyError

from foldback.server.errors import READ_ONLY_WORDS
from foldback.server.limits.disk_space import free_space
from foldback.server.settings import Settings
from foldback.server.store.leases import Leases
from foldback.server.store.object_store import StorageError

READINESS_CACHE_S: Final = 2.0
"""Time for which the checked state of disk, object store and workers is cached, in s; ``/ready``
reports it."""
OK: Final = "ok"
log = logging.getLogger("foldback.service")


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """State of each part: ``ok`` or the problem; ``workers`` is the number of live ones."""

    database: str
    disk: str
    storage: str
    workers: int
    reasons: tuple[str, ...]

    @property
    def ready(self) -> bool:
        """True if the service can accept folds."""
        return not self.reasons


@dataclass(frozen=True, slots=True, kw_only=True)
class Places:
    """State of this machine's disk and of the storage of folds.

    Attributes:
        disk: ``ok`` or the problem.
        storage: ``ok`` or the problem.
        free_bytes: Free space of the disk; None if it cannot be read.
    """

    disk: str
    storage: str
    free_bytes: int | None


class Readiness:
    """State of the parts that the service needs, cached for ``READINESS_CACHE_S``.

    Args:
        settings: The settings.
        leases: Leases of the workers.
        storage: Function that raises an error if the object store cannot be used.
    """

    def __init__(
        self, settings: Settings, leases: Leases, storage: Callable[[], None] = lambda: None
    ) -> None:
        self._storage = storage
        self._settings = settings
        self._leases = leases
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._dated_places: tuple[float, Places] | None = None

    def end(self) -> None:
        """Report the service as not ready from now on, as it is about to stop."""
        self._ending.set()

    def state(self) -> State:
        """Return the current state; that of disk and storage is cached."""
        database, workers = OK, 0
        try:
            workers = len(self._leases.workers())
        except SQLAlchemyError as error:
            log.warning("database: %r", error)
            database = "does not answer"
        places = self.places()
        reasons = [
            f"the {name} {state}" if state.startswith(("does", "can")) else f"{name}: {state}"
            for name, state in (
                ("database", database),
                ("disk", places.disk),
                ("storage", places.storage),
            )
            if state != OK
        ]
        if self._settings.read_only:
            reasons.insert(0, READ_ONLY_WORDS)
        elif database == OK and not workers and self._settings.workers:
            reasons.append("no worker is running")
        if self._ending.is_set():
            reasons.append("the service is stopping")
        return State(
            database=database,
            disk=places.disk,
            storage=places.storage,
            workers=workers,
            reasons=tuple(reasons),
        )

    def places(self) -> Places:
        """Return the state of disk and storage, cached for ``READINESS_CACHE_S``.

        Only one thread checks at a time. Others return the last result, even if the storage hangs.
        """
        if self._lock.acquire(blocking=self._dated_places is None):
            try:
                now = time.monotonic()
                if self._dated_places is None or now - self._dated_places[0] >= READINESS_CACHE_S:
                    self._dated_places = (now, self._look())
            finally:
                self._lock.release()
        assert self._dated_places is not None
        return self._dated_places[1]

    def _look(self) -> Places:
        disk, free_bytes = OK, None
        try:
            free_bytes = free_space(self._settings.root)
            if free_bytes < self._settings.min_free_disk_bytes:
                disk = f"only {free_bytes // 2**20} MiB free"
            else:
                check_folder(self._settings.uploads_dir)
        except OSError as error:
            disk = f"cannot be written: {error.strerror}"
        return Places(disk=disk, storage=self._storage_says(), free_bytes=free_bytes)

    def _storage_says(self) -> str:
        try:
            if self._settings.storage_url is None:
                check_folder(self._settings.folds_dir)
            else:
                self._storage()
        except (OSError, StorageError) as error:
            log.warning("storage: %r", error)
            return "cannot be used"
        return OK


def check_folder(folder: Path) -> None:
    """Write, read, list and delete a probe in a directory of this machine.

    Raises:
        OSError: If one of these fails.
    """
    handle, name = tempfile.mkstemp(prefix=".probe-", dir=folder)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(b"probe")
        with open(name, "rb") as file:
            if file.read() != b"probe" or os.path.basename(name) not in os.listdir(folder):
                raise OSError(0, "data that were written could not be read back")
    finally:
        with contextlib.suppress(OSError):
            os.unlink(name)
