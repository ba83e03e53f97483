"""Uploads: files on disk from their first bytes on, until they are accepted or removed.

Each process has a scratch directory under ``uploads_dir``. Files of ended processes were never
acknowledged, so they are removed.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from foldback.server.errors import ServiceError, Unavailable, Unusable, not_stored
from foldback.server.limits.concurrency_quota import BUSY_RETRY_S
from foldback.server.limits.disk_space import check_space
from foldback.server.processes.children import ChildError
from foldback.server.processes.scratch import Scratch
from foldback.server.settings import Settings
from foldback.server.store.folds import new_id


@dataclass(frozen=True, slots=True, kw_only=True)
class Upload:
    """An uploaded file in a directory of its own, which is moved into the store when accepted.

    Attributes:
        directory: Directory with the file ``input``, which is flushed to disk.
        filename: Name of the uploaded file, if any.
        digest: SHA-256 of the file.
    """

    directory: Path
    filename: str | None
    digest: str


class Uploads:
    """Uploads of one process. Thread-safe.

    Parts of forms are spooled beside them. A read-only service has no uploads.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._place = settings.uploads_dir
        self._scratch = ExitStack()
        self._spooled_before = tempfile.tempdir
        if settings.read_only:
            return
        scratch = Scratch(settings.uploads_dir)
        scratch.sweep()
        self._place = self._scratch.enter_context(scratch.directory())
        tempfile.tempdir = str(self._place)

    def close(self) -> None:
        """Remove the remaining files and release the directory."""
        if tempfile.tempdir == str(self._place):
            tempfile.tempdir = self._spooled_before
        self._scratch.close()

    @contextmanager
    def stored(self, source: BinaryIO, filename: str | None) -> Generator[Upload]:
        """Copy a file to the disk in chunks; remove it at the end unless it was moved.

        Raises:
            NoRoom: If the disk has no room for it.
        """
        directory = self._place / new_id()
        try:
            try:
                check_space(self._place, self._settings.min_free_disk_bytes)
                directory.mkdir()
                digest = _copied(source, directory / "input")
            except OSError as error:
                raise not_stored("upload", error) from error
            yield Upload(directory=directory, filename=filename, digest=digest)
        finally:
            shutil.rmtree(directory, ignore_errors=True)


def _copied(source: BinaryIO, path: Path) -> str:
    """Copy a file durably; return its digest."""
    digest = hashlib.sha256()
    with open(path, "xb") as file:
        while piece := source.read(2**18):
            digest.update(piece)
            file.write(piece)
        file.flush()
        os.fsync(file.fileno())
    return digest.hexdigest()


def not_read(error: ChildError) -> ServiceError:
    """Return the error for an upload that a child process could not read."""
    if error.temporary:
        return Unavailable(error.code, error.detail, retry_after_s=BUSY_RETRY_S)
    return Unusable("unreadable", f"reading the file failed: {error.detail}")
