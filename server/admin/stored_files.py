"""Files of folds in a local directory or an object store, for backups."""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import Final, TypeVar

from foldback.server.admin.backup_manifest import is_file_name
from foldback.server.settings import Settings
from foldback.server.store.object_store import TRANSFERS_AT_ONCE, Storage, open_storage
from foldback.server.store.staged_files import OBJECT_KEYS

Item = TypeVar("Item")
Answer = TypeVar("Answer")


class DirectoryFiles:
    """Files in the directory of folds, by their names in a backup: ``folds/<id>/…``."""

    kind: Final = "directory"
    storage: Final = None

    def __init__(self, settings: Settings) -> None:
        self._folds = settings.folds_dir

    def names(self) -> Iterator[str]:
        """Yield the names of all files except symbolic links."""
        for directory, _, files in os.walk(self._folds):
            below = Path("folds") / Path(directory).relative_to(self._folds)
            for file in files:
                name = (below / file).as_posix()
                if is_file_name(name) and not os.path.islink(os.path.join(directory, file)):
                    yield name

    def save(self, name: str, target: Path) -> bool:
        """Copy a file to an existing empty one; return False if it has been deleted meanwhile."""
        try:
            source = open_inside(self._folds.parent, f"{self._folds.name}/{name.partition('/')[2]}")
        except FileNotFoundError:
            return False
        with source, open(target, "wb") as file:
            shutil.copyfileobj(source, file)
        return True


class ObjectFiles:
    """Files in an object store: ``folds/<id>/…`` and ``movies/<id>/…``."""

    kind: Final = "objects"

    def __init__(self, storage: Storage) -> None:
        self.storage: Final = storage

    def names(self) -> Iterator[str]:
        """Yield the names of all files."""
        for key in OBJECT_KEYS:
            keys = (f"{key}/{name}" for name in self.storage.names(key))
            yield from filter(is_file_name, keys)

    def save(self, name: str, target: Path) -> bool:
        """Copy a file to an existing empty one; return False if it has been deleted meanwhile."""
        return self.storage.fetch_file(name, target)


StoredFiles = DirectoryFiles | ObjectFiles
"""Files of a service; the two kinds lay out files differently."""


@contextmanager
def stored_files(settings: Settings) -> Generator[StoredFiles]:
    """Open the files of a service.

    Raises:
        StorageError: If the object store's address is invalid, or obstore is missing.
    """
    storage = open_storage(settings)
    try:
        yield DirectoryFiles(settings) if storage is None else ObjectFiles(storage)
    finally:
        if storage is not None:
            storage.close()


def at_once(do: Callable[[Item], Answer], items: Iterable[Item]) -> list[Answer]:
    """Call a function for each item in a few threads; return the results in order."""
    with ThreadPoolExecutor(TRANSFERS_AT_ONCE) as threads:
        return list(threads.map(do, items))


def open_inside(directory: Path, name: str) -> BufferedReader:
    """Open a regular file below a directory without following a link in its name.

    Raises:
        OSError: If it is missing, not a regular file, or its path contains a symbolic link.
    """
    handle = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        *folders, last = name.split("/")
        for folder in folders:
            inner = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=handle)
            os.close(handle)
            handle = inner
        # Without O_NONBLOCK, opening a named pipe would wait for a writer.
        descriptor = os.open(last, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=handle)
    finally:
        os.close(handle)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise FileNotFoundError(f"{name} is not a regular file")
    return open(descriptor, "rb")
