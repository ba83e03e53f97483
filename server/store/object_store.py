"""Object store: files of folds outside of this machine.

It contains copies of directories under keys such as ``folds/<id>/<epoch>``. Machines work on local
directories: ``keep`` uploads the changes in a directory, ``fetch`` updates a local copy.
"""

from __future__ import annotations

import json
import logging
import secrets
import threading
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final, TypeVar

from foldback.planner.storage.array_files import HEAD
from foldback.planner.storage.file_names import TIMELINE
from foldback.planner.storage.files import unsealed_json, write_whole, written_aside
from foldback.server.settings import Settings

if TYPE_CHECKING:  # the extra `storage`
    from obstore.store import ObjectStore

TIMELINE_HEAD: Final = f"{TIMELINE}/{HEAD}"
"""File that lists the frames of a stored motion. It is uploaded after the frames, and
fetched copies get it last, so that a reader finds every frame that it counts."""
LOCAL_DIRS: Final = frozenset({"exports"})
"""Subdirectories of a fold's directory that are not copied to the object store, as each machine
computes their files again."""
FETCHED_INDEX: Final = ".fetched.json"
REMOVED_INDEX: Final = ".removed.json"
"""File beside stored files while some of them are being deleted: a list of their names. Whoever
fetches the directory ignores these files, because a crash may leave any part of them."""
TRANSFERS_AT_ONCE: Final = 8
"""Number of files that are transferred to or from the object store at the same time."""
log = logging.getLogger("foldback.storage")
Answer = TypeVar("Answer")


class StorageError(Exception):
    """The storage does not answer, or its answer is invalid."""


@dataclass(slots=True)
class _Uploaded:
    """What the store has of a directory that this process uploads.

    Attributes:
        marks: Modification time and size of each file; None while the file is being deleted.
        settled: Names of the files of the last upload at which nothing was growing.
    """

    marks: dict[str, tuple[int, int] | None] = field(
        default_factory=dict[str, tuple[int, int] | None]
    )
    settled: frozenset[str] = frozenset()


class Storage:
    """Directories in an object store. Safe for use by several threads.

    Args:
        store: The object store.
        name: Name in messages.
    """

    def __init__(self, store: ObjectStore, name: str) -> None:
        import obstore

        self._store = store
        self._obstore = obstore
        self._name = name
        self._lock = threading.Lock()
        self._uploaded: dict[str, _Uploaded] = {}
        self._threads = ThreadPoolExecutor(TRANSFERS_AT_ONCE, thread_name_prefix="storage")

    def check(self) -> None:
        """Write, read, list and remove a small file.

        Raises:
            StorageError: If one of these fails.
        """
        with self._storage_errors():
            name = f"check/{secrets.token_hex(8)}"
            self._obstore.put(self._store, name, b"foldback")
            try:
                if bytes(self._obstore.get(self._store, name).bytes()) != b"foldback":
                    raise StorageError(
                        f"{self._name} returned data that differ from what was stored."
                    )
                self._marks("check")
            finally:
                self._obstore.delete(self._store, name)

    def keep(self, key: str, directory: Path, *, growing: bool = False) -> int:
        """Upload the changes in a directory since the last call.

        Args:
            key: Name of the directory in the store.
            directory: The directory.
            growing: True if files are still being written and moved. Then files of the last call
                without it are not deleted, because a later execution may have to start from them.

        Returns:
            Total size of its files, bytes.

        Raises:
            StorageError: If the storage does not answer; its copy is still consistent.
        """
        with self._lock:
            uploaded = self._uploaded.setdefault(key, _Uploaded())
        marks = uploaded.marks
        unsure = None in marks.values()  # the last call failed while it deleted files
        # Read first, so that all frames that it states are uploaded before it.
        head = _read(directory / TIMELINE_HEAD)
        files = dict(_files(directory))
        changed = [
            name
            for name, mark in files.items()
            if marks.get(name) != mark and name != TIMELINE_HEAD
        ]
        with self._storage_errors():
            self._each(changed, lambda name: self._put(key, name, _read(directory / name)))
            marks.update({name: files[name] for name in changed})
            if head is not None and marks.get(TIMELINE_HEAD) != (mark := (hash(head), len(head))):
                self._put(key, TIMELINE_HEAD, head)
                marks[TIMELINE_HEAD] = mark
            spared = uploaded.settled if growing else frozenset[str]()
            removed_names = [name for name in marks if name not in files and name not in spared]
            if removed_names or unsure:
                self._delete_all(key, removed_names, marks)
        if not growing:
            uploaded.settled = frozenset(files)
        return sum(size for _, size in files.values())

    def _delete_all(
        self, key: str, removed_names: list[str], marks: dict[str, tuple[int, int] | None]
    ) -> None:
        """Delete files of a directory, so that whoever fetches it sees all of them or none."""
        marks.update(dict.fromkeys(removed_names))
        self._put(key, REMOVED_INDEX, json.dumps(removed_names).encode())
        self._each(removed_names, lambda name: self._delete(f"{key}/{name}"))
        self._delete(f"{key}/{REMOVED_INDEX}")
        for name in removed_names:
            del marks[name]

    def forget(self, key: str) -> None:
        """Forget the uploaded state of a directory, so that the next ``keep`` uploads all of it."""
        with self._lock:
            self._uploaded.pop(key, None)

    def fetch(self, key: str, directory: Path) -> bool:
        """Update a local copy from the storage; return False if the storage has no files.

        Raises:
            StorageError: If the storage does not answer; the copy is unchanged or newer.
        """
        marks: dict[str, str] = json.loads(_read(directory / FETCHED_INDEX) or b"{}")
        with self._storage_errors():
            for _ in range(5):  # its motion may be replaced meanwhile
                head, listed = self._get(f"{key}/{TIMELINE_HEAD}"), self._marks(key)
                if not listed:
                    return False
                removed = self._removed(key) if listed.pop(REMOVED_INDEX, None) else []
                listed = {name: mark for name, mark in listed.items() if name not in removed}
                headless = TIMELINE_HEAD in removed
                head = None if headless else head
                directory.mkdir(parents=True, exist_ok=True)
                missing_names = [
                    name
                    for name, mark in listed.items()
                    if name != TIMELINE_HEAD
                    and (marks.get(name) != mark or not (directory / name).exists())
                ]
                written = self._each(missing_names, lambda name: self._write(key, name, directory))
                marks.update({name: listed[name] for name in missing_names})
                after = None if headless else self._get(f"{key}/{TIMELINE_HEAD}")
                # If files are deleted meanwhile, a part of them may have been fetched.
                if all(written) and _identity(head) == _identity(after):
                    break
            else:
                raise StorageError(f"{key} in {self._name} changes faster than it can be read.")
        # An equal file is not rewritten, because derived files depend on its time stamp.
        if head is not None and _read(directory / TIMELINE_HEAD) != head:
            _write_whole(directory / TIMELINE_HEAD, head)
        for name in [name for name in marks if name not in listed]:
            _remove(directory / name, directory)
            del marks[name]
        write_whole(directory / FETCHED_INDEX, json.dumps(marks).encode())
        return True

    def fetch_file(self, key: str, path: Path) -> bool:
        """Download one file, which may be large; return False if there is none.

        Raises:
            StorageError: If the storage does not answer.
        """
        with self._storage_errors():
            try:
                stored = self._obstore.get(self._store, key)
            except FileNotFoundError:
                return False
            path.parent.mkdir(parents=True, exist_ok=True)
            with written_aside(path) as partial_path, open(partial_path, "wb") as file:
                for chunk in stored.stream():
                    file.write(chunk)
        return True

    def keep_file(self, key: str, path: Path | BinaryIO) -> None:
        """Upload one file.

        Raises:
            StorageError: If the storage does not answer.
        """
        with self._storage_errors():
            self._obstore.put(self._store, key, path)

    def remove_file(self, key: str) -> None:
        """Remove one file, if there is one.

        Raises:
            StorageError: If the storage does not answer.
        """
        with self._storage_errors():
            self._delete(key)

    def remove(self, key: str, *, but: str | None = None) -> None:
        """Remove all files below a key, except those below ``but``.

        Raises:
            StorageError: If the storage does not answer.
        """
        with self._storage_errors():
            names = [f"{key}/{name}" for name in self._marks(key)]
            spared = None if but is None else f"{but}/"
            removed_names = [
                name for name in names if spared is None or not name.startswith(spared)
            ]
            self._each(removed_names, self._delete)
        with self._lock:
            for uploaded_key in [k for k in self._uploaded if k == key or k.startswith(f"{key}/")]:
                if uploaded_key != but:
                    del self._uploaded[uploaded_key]

    def copy_all(self, key: str, names: list[str]) -> None:
        """Copy files below a key to their names without it, inside the store.

        Raises:
            StorageError: If the storage does not answer; some files may have been copied.
        """
        with self._storage_errors():
            self._each(names, lambda name: self._copy(f"{key}/{name}", name))

    def remove_files(self, names: list[str]) -> None:
        """Remove files by their names, if they exist.

        Raises:
            StorageError: If the storage does not answer; some files may have been removed.
        """
        with self._storage_errors():
            self._each(names, self._delete)

    def below(self, key: str) -> list[str]:
        """Return the names directly below a key.

        Raises:
            StorageError: If the storage does not answer.
        """
        with self._storage_errors():
            listing = self._obstore.list_with_delimiter(self._store, f"{key}/")
        return [prefix.rstrip("/").rpartition("/")[2] for prefix in listing["common_prefixes"]]

    def names(self, key: str) -> list[str]:
        """Return the names of all files below a key, relative to it.

        Raises:
            StorageError: If the storage does not answer.
        """
        with self._storage_errors():
            return list(self._marks(key))

    def close(self) -> None:
        """Stop the threads."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _put(self, key: str, name: str, data: bytes | None) -> None:
        if data is not None:  # otherwise it has just been deleted, and the next call notices
            self._obstore.put(
                self._store, f"{key}/{name}", data, use_multipart=len(data) > 64 * 2**20
            )

    def _get(self, name: str) -> bytes | None:
        try:
            return bytes(self._obstore.get(self._store, name).bytes())
        except FileNotFoundError:
            return None

    def _copy(self, name: str, target: str) -> None:
        self._obstore.copy(self._store, name, target)

    def _delete(self, name: str) -> None:
        try:
            self._obstore.delete(self._store, name)
        except FileNotFoundError:
            return

    def _marks(self, key: str) -> dict[str, str]:
        """Return the entity tag, or else the modification time, of each file below a key."""
        return {
            str(meta["path"]).removeprefix(f"{key}/"): str(meta["e_tag"] or meta["last_modified"])
            for batch in self._obstore.list(self._store, f"{key}/")
            for meta in batch
        }

    def _removed(self, key: str) -> list[str]:
        """Return the names of the files that are being deleted."""
        return json.loads(self._get(f"{key}/{REMOVED_INDEX}") or b"[]")

    def _write(self, key: str, name: str, directory: Path) -> bool:
        """Fetch a file; return False if it has been deleted."""
        path = directory / name
        if not path.resolve().is_relative_to(directory.resolve()):
            raise StorageError(
                f"{self._name} names a file {name!r}, expected a name within the fold's directory."
            )
        data = self._get(f"{key}/{name}")
        if data is not None:
            _write_whole(path, data)
        return data is not None

    def _each(self, things: list[Any], do: Callable[[Any], Answer]) -> list[Answer]:
        return list(self._threads.map(do, things))

    @contextmanager
    def _storage_errors(self) -> Generator[None]:
        from obstore.exceptions import BaseError

        try:
            yield
        except (BaseError, OSError) as error:
            if isinstance(error, OSError) and not isinstance(error, BaseError) and error.errno:
                raise  # the disk of this machine
            line = str(error).strip().partition("\n")[0][:300]
            raise StorageError(f"a request to {self._name} failed: {line}") from error


def open_storage(settings: Settings) -> Storage | None:
    """Return the object store in the settings; None if files are stored on this machine.

    Raises:
        StorageError: If the URL is of no known kind, or obstore is not installed.
    """
    url = settings.storage_url
    if url is None:
        return None
    try:
        from obstore.exceptions import BaseError
        from obstore.store import from_url
    except ImportError:
        raise StorageError(
            f"FOLDBACK_STORAGE_URL={url!r} needs obstore, which is not installed; install it with "
            "pip install 'foldback[storage]'"
        ) from None
    try:
        store = from_url(
            url,
            client_options={"timeout": "20s", "connect_timeout": "5s", "allow_http": True},
            retry_config={"max_retries": 4, "retry_timeout": timedelta(seconds=20)},
        )
    except (BaseError, ValueError) as error:
        raise StorageError(
            f"got FOLDBACK_STORAGE_URL={url!r}, expected something like s3://bucket/prefix: {error}"
        ) from error
    return Storage(store, url)  # pyright: ignore[reportArgumentType]


def _remove(path: Path, root: Path) -> None:
    """Remove a file and its empty parents below a root, because readers list directories."""
    path.unlink(missing_ok=True)
    with suppress(OSError):  # a directory that is not empty
        for parent in path.parents:
            if parent == root:
                return
            parent.rmdir()


def _files(directory: Path) -> Iterator[tuple[str, tuple[int, int]]]:
    """Yield the names of the files to store, with modification time and size."""
    for path in sorted(directory.rglob("*")):
        name = path.relative_to(directory).as_posix()
        parts = name.split("/")
        if parts[0] in LOCAL_DIRS or path.suffix == ".partial":
            continue
        if any(part.startswith(".") for part in parts):
            continue
        try:
            if path.is_file() and not path.is_symlink():
                stat = path.stat()
                yield name, (stat.st_mtime_ns, stat.st_size)
        except OSError:  # it has just been deleted
            continue


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None


def _write_whole(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, data)


def _identity(head: bytes | None) -> str | None:
    """Return the id of a timeline with this head; None if there is none, or it is damaged."""
    try:
        return None if head is None else unsealed_json(head).get("id")
    except (ValueError, RecursionError):
        return None
