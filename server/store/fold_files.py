"""Fold files: directories with the files of folds on this machine.

Without an object store, each fold has one directory, which all processes share. With one, a worker
computes in a directory of the fold's epoch and uploads its files under this epoch; readers have
copies of the files of the last published epoch.
"""

from __future__ import annotations

import os
import secrets
import shutil
import threading
import time
import weakref
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import Final

from foldback.planner.errors import UNREADABLE, TimelineError
from foldback.planner.motion.timeline import frames_on_disk
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.storage.file_names import TIMELINE
from foldback.planner.storage.files import sync, written_aside
from foldback.server.errors import NoSuch
from foldback.server.settings import Settings
from foldback.server.store.object_store import FETCHED_INDEX, Storage, open_storage
from foldback.server.store.schema import FoldRow

COPY_CACHE_S: Final = 0.4
"""Maximum age of the local copy of a running fold's files before they are compared with the object
store again, in s."""
CACHE_SWEEP_S: Final = 60.0
"""Minimum time between two deletions of the least recently used local copies of folds' files, in
s."""
MIN_COPY_AGE_S: Final = 600.0
"""Time since its last use within which a local copy of a fold's files is not deleted, in s, as a
request may be reading it."""
WHOLE_FILE: Final = ".whole"
"""Name of the empty file in a work directory that is written when all files have been fetched."""
REMOVED_PREFIX: Final = ".going-"
"""Prefix that a local copy's directory gets before its files are deleted, so that no reader finds
it."""
MOVIES: Final = "movies"
EXPORTS_DIR: Final = "exports"
"""Subdirectory of a fold's directory for files that are computed on request, such as exports."""
DERIVED_DIRS: Final = (EXPORTS_DIR, MOVIES)
"""Subdirectories of a fold's directory with files that can be computed again. Their size counts
separately from the fold's own files."""


class NoSuchFoldError(NoSuch):
    """There is no fold with this id."""

    def __init__(self, fold_id: str) -> None:
        super().__init__(
            "no-such-fold", ("There is no fold at this address; it may have been deleted.")
        )


class Folders:
    """Files of folds. Safe for use by several threads.

    Args:
        settings: The settings.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self.storage: Storage | None = open_storage(settings)
        self._lock = threading.Lock()
        self._locks: weakref.WeakValueDictionary[str, threading.Lock] = (
            weakref.WeakValueDictionary()
        )
        self._looked: dict[str, tuple[float, bool]] = {}
        self._tidied = 0.0
        settings.make_directories()
        if self.storage is not None and not settings.read_only:
            for directory in (settings.work_dir, settings.cache_dir):
                directory.mkdir(parents=True, exist_ok=True)

    def close(self) -> None:
        """Close the storage."""
        if self.storage is not None:
            self.storage.close()

    def check(self) -> None:
        """Raise StorageError if the storage does not answer."""
        if self.storage is not None:
            self.storage.check()

    def place(self, fold_id: str) -> Path:
        """Return a fold's directory; ids are checked before they become a path.

        Raises:
            NoSuchFoldError: If this is not an id.
        """
        if not (fold_id.isascii() and fold_id.isalnum() and len(fold_id) <= 32):
            raise NoSuchFoldError(fold_id)
        settings = self._settings
        return (settings.folds_dir if self.storage is None else settings.work_dir) / fold_id

    def work_place(self, fold_id: str, epoch: int) -> Path:
        """Return the directory in which a fold is computed in an epoch.

        With an object store, each epoch has a directory of its own, because a suspended process of
        an earlier epoch may still write into its directory.
        """
        place = self.place(fold_id)
        return place if self.storage is None else place / str(epoch)

    # For readers

    def shown(self, row: FoldRow) -> Path:
        """Return the directory of a fold for readers; fetch it from the object store if needed.

        Raises:
            StorageError: If the storage does not answer.
        """
        if self.storage is None:
            return self.place(row.id)
        copy = self._settings.cache_dir / f"{row.id}-{row.kept}"
        with self._lock_of(copy.name):
            at, is_whole = self._looked.get(copy.name, (-COPY_CACHE_S, False))
            now = time.monotonic()
            # A copy made before the end lacks files; for a running fold a recent copy suffices.
            enough = is_whole if row.over else now - at < COPY_CACHE_S
            if not (enough and (copy / FETCHED_INDEX).is_file()):
                self.storage.fetch(_key(row.id, row.kept), copy)
                self._looked[copy.name] = (now, row.over)
            with suppress(OSError):
                os.utime(copy)
        self._tidy()
        return copy

    def movie(self, fold_id: str, name: str) -> Path | None:
        """Return the file of a movie, fetched from the object store if needed; None if missing.

        Raises:
            StorageError: If the storage does not answer.
        """
        if self.storage is None:
            path = self.place(fold_id) / MOVIES / name
            return path if path.is_file() else None
        copy = self._settings.cache_dir / f"{self.place(fold_id).name}-{name}"
        path = copy / name
        with self._lock_of(copy.name):
            if not path.is_file() and not self.storage.fetch_file(_movie_key(fold_id, name), path):
                return None
            with suppress(OSError):
                os.utime(copy)
        self._tidy()
        return path

    def copied(self) -> set[str]:
        """Return the folds with local copies of their files."""
        if self.storage is None:
            return set()
        names = {copy.name for copy in self._settings.cache_dir.iterdir()}
        return {name.partition("-")[0] for name in names if not name.startswith(".")}

    # For uploads

    def adopt(self, new_dir: Path, fold_id: str) -> None:
        """Move the directory of a new fold into place, whole or not at all.

        Raises:
            OSError: If the disk is full.
            StorageError: If the storage does not answer.
        """
        if self.storage is None:
            place = self.place(fold_id)
            os.rename(new_dir, place)
            sync(place.parent)
        else:
            key = _key(fold_id, 0)
            self.storage.keep(key, new_dir)
            self.storage.forget(key)

    def remove(self, fold_id: str) -> None:
        """Remove all files of a fold.

        Raises:
            StorageError: If the storage does not answer.
        """
        shutil.rmtree(self.place(fold_id), ignore_errors=True)
        if self.storage is not None:
            self.storage.remove(f"folds/{fold_id}")
            self.storage.remove(f"movies/{fold_id}")
            for copy in self._settings.cache_dir.glob(f"{fold_id}-*"):
                self._drop(copy)

    # For movies

    def keep_movie(self, fold_id: str, name: str, path: Path) -> None:
        """Store a complete movie file for readers.

        Raises:
            NoSuchFoldError: If the fold no longer exists.
            OSError: If the disk is full.
            StorageError: If the storage does not answer.
        """
        if self.storage is not None:
            self.storage.keep_file(_movie_key(fold_id, name), path)
            return
        place = self.place(fold_id)
        if not place.is_dir():
            raise NoSuchFoldError(fold_id)
        movies = place / MOVIES
        movies.mkdir(exist_ok=True)
        with written_aside(movies / name, durable=True) as partial_path:
            shutil.copyfile(path, partial_path)

    def remove_movie(self, fold_id: str, name: str) -> None:
        """Remove the file of a movie, if there is one.

        Raises:
            StorageError: If the storage does not answer.
        """
        with suppress(OSError):
            (self.place(fold_id) / MOVIES / name).unlink(missing_ok=True)
        if self.storage is not None:
            self.storage.remove_file(_movie_key(fold_id, name))
            shutil.rmtree(self._settings.cache_dir / f"{fold_id}-{name}", ignore_errors=True)

    # For housekeeping

    def remove_exports(self, fold_id: str, *, before: float) -> tuple[int, int]:
        """Remove a fold's derived files on this machine that are older than a time.

        Args:
            fold_id: The fold.
            before: The time, in seconds since 1970.

        Returns:
            Total size of the removed files, and of the remaining ones, in bytes.
        """
        removed_bytes = left_bytes = 0
        for path in (self.place(fold_id) / EXPORTS_DIR).glob("*"):
            with suppress(OSError):  # another process has just removed it
                stat = path.stat()
                if stat.st_mtime < before:
                    path.unlink()
                    removed_bytes += stat.st_size
                else:
                    left_bytes += stat.st_size
        return removed_bytes, left_bytes

    # For workers

    def bring(self, fold_id: str, kept_epoch: int, epoch: int) -> Path:
        """Return a fold's work directory for an epoch, with all files of the earlier one.

        With an object store, directories of earlier epochs on this machine are removed.

        Args:
            fold_id: The fold.
            kept_epoch: Epoch of the last stage that has ended.
            epoch: Current epoch.

        Raises:
            StorageError: If the storage does not answer.
        """
        place = self.work_place(fold_id, epoch)
        if self.storage is None or (place / WHOLE_FILE).exists():
            return place
        for other_dir in self.place(fold_id).glob("*"):
            if other_dir.name.isdecimal() and int(other_dir.name) < epoch:
                shutil.rmtree(other_dir, ignore_errors=True)
        self.storage.fetch(_key(fold_id, kept_epoch), place)
        place.mkdir(parents=True, exist_ok=True)
        (place / WHOLE_FILE).touch()
        return place

    def keep(self, fold_id: str, epoch: int, *, growing: bool = False) -> int:
        """Store the files in a fold's directory; return their size, without derived files.

        Args:
            fold_id: The fold.
            epoch: Epoch of the execution.
            growing: True while a stage computes.

        Raises:
            StorageError: If the storage does not answer.
        """
        place = self.work_place(fold_id, epoch)
        if self.storage is None:
            return size_of(place, but=DERIVED_DIRS)
        return self.storage.keep(_key(fold_id, epoch), place, growing=growing)

    def leave(self, fold_id: str, epoch: int) -> None:
        """Clean up after an ended fold, except for the files of its last epoch.

        Raises:
            StorageError: If the storage does not answer.
        """
        if self.storage is not None:
            shutil.rmtree(self.place(fold_id), ignore_errors=True)
            self.storage.remove(f"folds/{fold_id}", but=_key(fold_id, epoch))
            self.storage.forget(_key(fold_id, epoch))

    def _lock_of(self, name: str) -> threading.Lock:
        with self._lock:
            return self._locks.setdefault(name, threading.Lock())

    def _tidy(self) -> None:
        """Remove the least recently used copies if there are too many."""
        now = time.time()
        with self._lock:
            if 0 <= now - self._tidied < CACHE_SWEEP_S:
                return
            self._tidied = now
        copies: list[tuple[float, int, Path]] = []
        for copy in self._settings.cache_dir.iterdir():
            with suppress(OSError):  # another process has just removed it
                if copy.is_dir():
                    copies.append((copy.stat().st_mtime, size_of(copy), copy))
        copies.sort()
        total = sum(size for _, size, _ in copies)
        for used, size, copy in copies:
            if total <= self._settings.cache_bytes:
                return
            if now - used > MIN_COPY_AGE_S:
                self._drop(copy)
                total -= size

    def _drop(self, copy: Path) -> None:
        """Remove a copy atomically, so that no reader sees a part of it or writes into it."""
        going = copy.with_name(f"{REMOVED_PREFIX}{copy.name}-{secrets.token_hex(4)}")
        with self._lock_of(copy.name):
            self._looked.pop(copy.name, None)
            with suppress(OSError):
                copy.rename(going)
        shutil.rmtree(going, ignore_errors=True)


def size_of(directory: Path, *, but: Collection[str] = ()) -> int:
    """Return the size of all files in a directory, except those in ``but``."""
    total = 0
    for path in directory.rglob("*"):
        if path.relative_to(directory).parts[0] in but:
            continue
        with suppress(OSError):
            if path.is_file() and not path.is_symlink():
                total += path.stat().st_size
    return total


def _key(fold_id: str, epoch: int) -> str:
    return f"folds/{fold_id}/{epoch}"


def _movie_key(fold_id: str, name: str) -> str:
    return f"movies/{fold_id}/{name}"


def frames_promised(directory: Path) -> int:
    """Return the number of frames that a fold's timeline states; 0 if there is none."""
    try:
        return frames_on_disk(result_path(directory, TIMELINE))
    except (TimelineError, *UNREADABLE):
        return 0
