"""Uploads: on disk from the first bytes on, until they are accepted or removed.

Each process has a directory of its own under ``uploads_dir``, held by a lock for as long as the
process lives; what dead processes have left there was never acknowledged, and is swept away.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path
from typing import IO, BinaryIO, Final

from server.errors import not_stored
from server.limits.disk_space import check_space
from server.settings import Settings
from server.store.folds import new_id

UPLOAD_CHUNK_BYTES: Final = 2**18
"""Number of bytes of an uploaded file that are copied and hashed at once. A larger value takes more
memory; a smaller one is slower. Chosen."""
LOCK_FILE: Final = "lock"


@dataclass(frozen=True, slots=True, kw_only=True)
class Upload:
    """Something to be read, in a directory of its own: moved into its place when it is accepted.

    Attributes:
        directory: Holds the file ``input``, which is safe on disk.
        filename: Name of the uploaded file, if any.
        digest: SHA-256 of the file.
        size: Its bytes.
    """

    directory: Path
    filename: str | None
    digest: str
    size: int


class Uploads:
    """The uploads of one process. Safe to use from many threads.

    What a form brings is spooled beside them, so that it is swept away with them. On a read-only
    disk there are none.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        root = settings.uploads_dir
        self._place = root / f"{os.getpid()}-{new_id()}"
        self._lock: IO[str] | None = None
        self._spooled_before = tempfile.tempdir
        if settings.read_only:
            return
        root.mkdir(parents=True, exist_ok=True)
        _sweep(root)
        self._lock = _made(self._place)
        tempfile.tempdir = str(self._place)

    @property
    def place(self) -> Path:
        """The directory of this process."""
        return self._place

    def close(self) -> None:
        """Remove the remaining files and release the directory."""
        if tempfile.tempdir == str(self._place):
            tempfile.tempdir = self._spooled_before
        shutil.rmtree(self._place, ignore_errors=True)
        if self._lock is not None:
            self._lock.close()

    @contextmanager
    def stored(self, source: BinaryIO, filename: str | None) -> Generator[Upload]:
        """Copy a file to the disk in chunks; remove it at the end unless it was moved.

        Raises:
            NoRoom: When the disk has no room for it.
        """
        directory = self._place / new_id()
        try:
            try:
                check_space(self._place, self._settings.min_free_disk_bytes)
                directory.mkdir()
                digest, size = _copied(source, directory / "input")
            except OSError as error:
                raise not_stored("upload", error) from error
            yield Upload(directory=directory, filename=filename, digest=digest, size=size)
        finally:
            shutil.rmtree(directory, ignore_errors=True)


def _copied(source: BinaryIO, path: Path) -> tuple[str, int]:
    """Copy a file durably; return its digest and size."""
    digest, size = hashlib.sha256(), 0
    with open(path, "xb") as file:
        while piece := source.read(UPLOAD_CHUNK_BYTES):
            digest.update(piece)
            size += file.write(piece)
        file.flush()
        os.fsync(file.fileno())
    return digest.hexdigest(), size


def _made(place: Path) -> IO[str]:
    """Create a directory that sweeps spare while its returned lock is open.

    It gets its name when it is locked: nobody may find it before.
    """
    aside = place.with_name(f".{place.name}")
    aside.mkdir(mode=0o700)
    lock = open(aside / LOCK_FILE, "w")  # noqa: SIM115 (held for the life of the process)
    flock(lock, LOCK_EX | LOCK_NB)
    aside.rename(place)
    return lock


def _sweep(root: Path) -> None:
    """Remove directories without a lock holder."""
    for left in root.iterdir():
        if left.name.startswith("."):
            continue  # just being made
        if left.is_symlink() or not left.is_dir():
            left.unlink(missing_ok=True)
        elif not _held(left):
            shutil.rmtree(left, ignore_errors=True)


def _held(place: Path) -> bool:
    """Return True if a living process holds the lock of a directory."""
    try:
        with open(place / LOCK_FILE) as lock:
            flock(lock, LOCK_EX | LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False
