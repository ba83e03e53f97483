"""Readiness: whether this process can take folds now, and if not, why."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Final

from sqlalchemy.exc import SQLAlchemyError

from server.census import Census
from server.settings import Settings

KEPT_S: Final = 2.0
OK: Final = "ok"


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """What was found: ``ok`` or what is wrong, of each part; ``workers`` is how many live."""

    database: str
    disk: str
    storage: str
    workers: int
    reasons: tuple[str, ...]

    @property
    def ready(self) -> bool:
        """Whether nothing speaks against taking folds."""
        return not self.reasons


class Readiness:
    """Looks at what the service needs, at most every ``KEPT_S``.

    Args:
        settings: The settings.
        census: Knows the workers.
    """

    def __init__(self, settings: Settings, census: Census) -> None:
        self._settings = settings
        self._census = census
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._kept: tuple[float, str, str] | None = None

    def end(self) -> None:
        """From now on it is not ready: the service is about to end."""
        self._ending.set()

    def state(self) -> State:
        """What is found now; disk and storage as of a moment ago."""
        database, workers = OK, 0
        try:
            workers = self._census.workers()
        except SQLAlchemyError as error:
            database = f"does not answer: {type(error).__name__}"
        disk, storage = self._places()
        reasons = [
            f"the {name} {found}" if found.startswith(("does", "can")) else f"{name}: {found}"
            for name, found in (("database", database), ("disk", disk), ("storage", storage))
            if found != OK
        ]
        if database == OK and not workers and self._settings.workers:
            reasons.append("no worker lives")
        if self._ending.is_set():
            reasons.append("the service is ending")
        return State(
            database=database, disk=disk, storage=storage, workers=workers, reasons=tuple(reasons)
        )

    def _places(self) -> tuple[str, str]:
        with self._lock:
            now = time.monotonic()
            if self._kept is None or now - self._kept[0] >= KEPT_S:
                self._kept = (now, disk_says(self._settings), storage_says(self._settings))
            return self._kept[1:]


def disk_says(settings: Settings) -> str:
    """``ok`` when uploads can be written here and there is room for them, or what is wrong."""
    try:
        free = shutil.disk_usage(settings.root).free
        if free < settings.min_free_disk_bytes:
            return f"{free // 2**20} MiB free"
        with tempfile.NamedTemporaryFile(dir=settings.uploads_dir) as probe:
            probe.write(b"probe")
            probe.flush()
    except OSError as error:
        return f"cannot be written: {error.strerror}"
    return OK


def storage_says(settings: Settings) -> str:
    """``ok`` when the files of folds can be kept and found again, or what is wrong."""
    try:
        check_storage(settings)
    except Exception as error:  # each kind of storage has its own kinds of error
        return f"cannot be used: {type(error).__name__}"
    return OK


def check_storage(settings: Settings) -> None:
    """Writes, reads, lists and deletes a probe where the files of folds are kept.

    Raises:
        Exception: When that does not work; which one depends on the kind of storage.
    """
    if settings.storage_url is None:
        _check_folder(settings)
        return
    storage: Callable[[Settings], object] = import_module("server.storage").open_storage
    opened = storage(settings)
    check: Callable[[], None] = opened.check  # type: ignore[attr-defined]
    check()


def _check_folder(settings: Settings) -> None:
    folder = settings.folds_dir
    handle, name = tempfile.mkstemp(prefix=".probe-", dir=folder)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(b"probe")
        with open(name, "rb") as file:
            if file.read() != b"probe" or os.path.basename(name) not in os.listdir(folder):
                raise OSError(0, "what was written is not what is read")
    finally:
        with contextlib.suppress(OSError):
            os.unlink(name)
