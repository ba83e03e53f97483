"""Files of a backup: staged beside the files of the service, then moved into their place.

The transaction that replaces the rows also stores the number of the staged files. From its commit
on, these are the service's files, and whoever opens the store next moves them into place. A restore
that ends at any moment thus leaves either the old rows and files, or the new ones.
"""

from __future__ import annotations

import errno
import logging
import re
import shutil
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final

import sqlalchemy as sa

from foldback.planner.storage.files import settle
from foldback.server.settings import Settings
from foldback.server.store.object_store import Storage, StorageError
from foldback.server.store.schema import CounterRow, changing_alone, is_read_only

RESTORED_COUNTER: Final = "restored files"
"""Name of the counter with the number of the staged files that have to be moved into place."""
STAGED_PREFIX: Final = ".restored-"
"""Prefix of the directories with staged and replaced files, within the directory of folds."""
STAGED_KEY: Final = "restored"
"""Key below which files are staged in an object store."""
COMPLETE: Final = ".complete"
"""Name of the empty object that is stored when all other objects have been staged."""
OBJECT_KEYS: Final = ("folds", "movies")
"""Keys of the service's files in an object store."""
log = logging.getLogger("foldback.restore")


class StagedFolders:
    """Staged files on this machine. They are moved, not copied, so that a full disk is no obstacle.

    Args:
        folds: Directory of folds.
        number: Number of the staged files.
    """

    def __init__(self, folds: Path, number: int) -> None:
        self._folds = folds
        self._staged, self._entering, self._replaced = (
            folds / f"{STAGED_PREFIX}{number:016x}.{state}"
            for state in ("staged", "entering", "replaced")
        )

    def write(self, name: str, source: BinaryIO) -> None:
        """Stage a file.

        Raises:
            OSError: If it cannot be written.
        """
        target = self._staged / name.removeprefix("folds/")
        target.parent.mkdir(parents=True, exist_ok=True)
        with open(target, "xb") as file:
            shutil.copyfileobj(source, file)

    def complete(self) -> None:
        """Write all staged files to the disk.

        Raises:
            OSError: If the disk cannot be written.
        """
        self._staged.mkdir(exist_ok=True)
        settle(self._folds)

    def move_into_place(self) -> None:
        """Replace the service's files; a call that was interrupted is continued by the next one.

        Raises:
            OSError: If the staged files are missing, or the disk cannot be written.
        """
        if self._staged.is_dir():
            self._replaced.mkdir(exist_ok=True)
            for path in self._service_files():
                path.rename(self._replaced / path.name)
            self._staged.rename(self._entering)
        elif not self._entering.is_dir():
            raise FileNotFoundError(
                errno.ENOENT, "it lacks the files of an unfinished restore", str(self._folds)
            )
        for path in list(self._entering.iterdir()):
            path.rename(self._folds / path.name)
        settle(self._folds)

    def discard(self) -> None:
        """Delete the staged and the replaced files."""
        for path in (self._staged, self._entering, self._replaced):
            shutil.rmtree(path, ignore_errors=True)

    def _service_files(self) -> list[Path]:
        return [path for path in self._folds.iterdir() if not path.name.startswith(STAGED_PREFIX)]


class StagedObjects:
    """Staged files in an object store, which copies them into place.

    Args:
        storage: The object store.
        number: Number of the staged files.
    """

    def __init__(self, storage: Storage, number: int) -> None:
        self._storage = storage
        self._key = f"{STAGED_KEY}/{number:016x}"

    def write(self, name: str, source: BinaryIO) -> None:
        """Stage a file.

        Raises:
            StorageError: If the storage does not answer.
        """
        self._storage.keep_file(f"{self._key}/{name}", source)

    def complete(self) -> None:
        """Mark the staged files as complete.

        Raises:
            StorageError: If the storage does not answer.
        """
        self._storage.keep_file(f"{self._key}/{COMPLETE}", BytesIO())

    def move_into_place(self) -> None:
        """Replace the service's files; a call that was interrupted is repeated by the next one.

        Raises:
            StorageError: If the staged files are missing, or the storage does not answer.
        """
        names = self._storage.names(self._key)
        if COMPLETE not in names:
            raise StorageError(f"{self._key} lacks the files of an unfinished restore.")
        names.remove(COMPLETE)
        self._storage.copy_all(self._key, names)
        stored = {f"{key}/{name}" for key in OBJECT_KEYS for name in self._storage.names(key)}
        self._storage.remove_files(sorted(stored.difference(names)))

    def discard(self) -> None:
        """Delete the staged files.

        Raises:
            StorageError: If the storage does not answer.
        """
        self._storage.remove(self._key)


StagedFiles = StagedFolders | StagedObjects
"""Staged files of a service; its two kinds of storage lay out files differently."""


def staged_files(settings: Settings, storage: Storage | None, number: int) -> StagedFiles:
    """Return the staged files of a number, which need not exist yet."""
    if storage is None:
        return StagedFolders(settings.folds_dir, number)
    return StagedObjects(storage, number)


def staged_numbers(settings: Settings, storage: Storage | None) -> Iterator[int]:
    """Yield the numbers of all staged files, those of interrupted restores included.

    Raises:
        StorageError: If the storage does not answer.
    """
    if storage is None:
        paths = settings.folds_dir.glob(f"{STAGED_PREFIX}*")
        names = {path.name.removeprefix(STAGED_PREFIX).partition(".")[0] for path in paths}
    else:
        names = set(storage.below(STAGED_KEY))
    yield from (int(name, 16) for name in names if re.fullmatch("[0-9a-f]{16}", name))


def restored_number(connection: sa.Connection) -> int | None:
    """Return the number of the staged files that have to be moved into place; None if none."""
    if not sa.inspect(connection).has_table(CounterRow.__tablename__):
        return None
    query = sa.select(CounterRow.value).where(CounterRow.name == RESTORED_COUNTER)
    return connection.scalar(query)


def discard_staged(connection: sa.Connection, settings: Settings, storage: Storage | None) -> None:
    """Delete the staged files of interrupted restores, except those to be moved into place.

    Args:
        connection: Connection of ``changing_alone`` or of a restore: no other restore may run.
        settings: The settings.
        storage: The object store; None if files are stored on this machine.

    Raises:
        StorageError: If the storage does not answer.
    """
    for number in set(staged_numbers(settings, storage)) - {restored_number(connection)}:
        staged_files(settings, storage, number).discard()


def finish_restore(engine: sa.Engine, settings: Settings, storage: Storage | None) -> None:
    """Move the staged files of a restore into place, if this has not been done yet.

    Raises:
        OSError: If the staged files are missing, or the disk cannot be written.
        StorageError: If the storage does not answer.
        SQLAlchemyError: If the database does not answer.
    """
    with engine.connect() as connection:
        if restored_number(connection) is None:
            return
    if is_read_only(engine):
        words = "the disk is read-only, and a restore on it is unfinished"
        raise OSError(errno.EROFS, words, str(settings.root))
    with changing_alone(engine) as connection:
        number = restored_number(connection)
        if number is None:  # another process has just finished it
            return
        log.info("moving restored files into place")
        staged = staged_files(settings, storage, number)
        staged.move_into_place()
        for copies in (settings.work_dir, settings.cache_dir):  # copies of the replaced files
            for path in copies.glob("*"):
                shutil.rmtree(path, ignore_errors=True)
        connection.execute(sa.delete(CounterRow).where(CounterRow.name == RESTORED_COUNTER))
    with suppress(StorageError):  # a worker deletes the rest later
        staged.discard()
