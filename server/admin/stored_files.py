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
from typing import TypeVar

from planner.files import temporary_path
from server.admin.backup_manifest import is_file_name
from server.settings import Settings
from server.store.object_store import TRANSFERS_AT_ONCE, Storage, open_storage

Item = TypeVar("Item")
Answer = TypeVar("Answer")


class DirectoryFiles:
    """Files in the directory of folds, by their names in a backup: ``folds/<id>/…``."""

    kind = "directory"

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

    def replace(self, names: Iterable[str], opened: Callable[[str], BufferedReader]) -> None:
        """Replace all files; the new ones are complete before the old ones are deleted.

        Args:
            names: Names of the new files.
            opened: Opens a new file by its name.
        """
        aside = temporary_path(self._folds / "restored")
        aside.mkdir(mode=0o700)
        try:
            for name in names:
                target = aside / name.removeprefix("folds/")
                target.parent.mkdir(parents=True, exist_ok=True)
                with opened(name) as source, open(target, "xb") as file:
                    shutil.copyfileobj(source, file)
            for path in self._folds.iterdir():
                if path != aside:
                    shutil.rmtree(
                        path
                    ) if path.is_dir() and not path.is_symlink() else path.unlink()
            for path in aside.iterdir():
                path.rename(self._folds / path.name)
        finally:
            shutil.rmtree(aside, ignore_errors=True)


class ObjectFiles:
    """Files in an object store: ``folds/<id>/…`` and ``movies/<id>/…``."""

    kind = "objects"

    def __init__(self, storage: Storage) -> None:
        self._storage = storage

    def names(self) -> Iterator[str]:
        """Yield the names of all files."""
        for key in ("folds", "movies"):
            found = (f"{key}/{name}" for name in self._storage.names(key))
            yield from filter(is_file_name, found)

    def save(self, name: str, target: Path) -> bool:
        """Copy a file to an existing empty one; return False if it has been deleted meanwhile."""
        return self._storage.fetch_file(name, target)

    def replace(self, names: Iterable[str], opened: Callable[[str], BufferedReader]) -> None:
        """Replace all files."""

        def upload(name: str) -> None:
            with opened(name) as source:
                self._storage.keep_file(name, source)

        for key in ("folds", "movies"):
            self._storage.remove(key)
        at_once(upload, names)


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
        found = os.open(last, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=handle)
    finally:
        os.close(handle)
    if not stat.S_ISREG(os.fstat(found).st_mode):
        os.close(found)
        raise FileNotFoundError(f"{name} is not a regular file")
    return open(found, "rb")
