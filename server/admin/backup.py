"""Backup and restoration of a service: its rows and its files.

A backup is a directory with the rows of the database, the stored files, and a manifest. Previews
and caches are not included.
"""

from __future__ import annotations

import os
import secrets
import time
from collections import Counter
from collections.abc import Collection, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Final

import sqlalchemy as sa
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from foldback.planner.storage.files import settle
from foldback.server.admin.backup_manifest import (
    MANIFEST,
    MAX_MANIFEST_BYTES,
    ROWS,
    BackupFile,
    Manifest,
)
from foldback.server.admin.backup_rows import load_rows, write_rows
from foldback.server.admin.database import consistent_view, drop_schema, has_schema, replacement
from foldback.server.admin.errors import AdminError
from foldback.server.admin.migration import schema_of
from foldback.server.admin.stored_files import StoredFiles, at_once, open_inside, stored_files
from foldback.server.limits.disk_space import free_space
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.object_store import StorageError
from foldback.server.store.schema import CounterRow, upgrade
from foldback.server.store.schema_version import Schema
from foldback.server.store.staged_files import (
    RESTORED_COUNTER,
    StagedFiles,
    discard_staged,
    restored_number,
    staged_files,
)

BLOCK_BYTES: Final = 4096
"""Usual size of a disk's blocks, in bytes; a file takes a whole number of them."""


@dataclass(frozen=True, slots=True)
class Restored:
    """A restored backup.

    Attributes:
        manifest: Its content.
        left_out: Number of folds that were left out, because the backup has no files of them.
    """

    manifest: Manifest
    left_out: int


def back_up(settings: Settings, directory: Path) -> Manifest:
    """Write a backup of a service, which may be running.

    Args:
        settings: The settings of the service.
        directory: Directory of the backup, empty or missing.

    Raises:
        AdminError: If there is nothing to back up, a restore is unfinished, or the directory is
            not empty.
        SQLAlchemyError: If the database does not answer.
        StorageError: If the object store does not answer.
        OSError: If a file cannot be read or written.
    """
    if schema_of(settings).version is None:
        raise AdminError(
            f"got an empty database for the data directory {settings.root}, expected "
            "rows to back up; check FOLDBACK_DATA_DIR and FOLDBACK_DATABASE_URL."
        )
    _make_empty(directory)
    created_at = time.time()
    with consistent_view(settings.store_url) as connection:
        schema = Schema.of(connection).version
        if schema is None or restored_number(connection) is not None:
            raise AdminError(
                "got a service with an unfinished restore; finish it with `foldback admin list`."
            )
        with open(_make_private(directory / ROWS), "wb") as file:
            ids = write_rows(connection, file)
    with stored_files(settings) as stored:
        names = (name for name in stored.names() if name.split("/")[1] in ids)
        saved_files = at_once(lambda name: _save(stored, name, directory), names)
        manifest = Manifest(
            foldback=version("foldback"),
            created_at=created_at,
            schema=schema,
            storage=stored.kind,
            rows=_described(directory, ROWS),
            files=tuple(file for file in saved_files if file is not None),
        )
    _make_private(directory / MANIFEST).write_bytes(manifest.text())
    settle(directory)
    return manifest


def restore(settings: Settings, directory: Path, *, replace: bool) -> Restored:
    """Restore the state of a service from a backup. All its processes must be stopped.

    Rows and files are staged beside the old ones. The commit of one transaction replaces them: if
    this process ends before, nothing has changed; if it ends later, the next process that opens the
    store moves the files into place.

    Args:
        settings: The settings of the service.
        directory: Directory of the backup.
        replace: True to delete and replace existing folds; otherwise they are an error.

    Raises:
        AdminError: If the backup is damaged or of another kind, the service is not empty or runs,
            or the disk, the database or the storage is full or does not answer.
    """
    manifest = _read(directory)
    number = secrets.randbits(62)
    with _unchanged(), stored_files(settings) as stored:
        _check_storage(manifest, stored)
        settings.make_directories()
        _check_space(settings, manifest)
        _check_digests(manifest, directory)
        staged = staged_files(settings, stored.storage, number)
        with replacement(settings.store_url) as connection:
            if not replace and (has_schema(connection) or next(stored.names(), None)):
                raise AdminError(
                    "got a service that already has data, expected an empty one; delete the data "
                    "with --replace, or name an empty data directory, database and object store."
                )
            discard_staged(connection, settings, stored.storage)
            try:
                left_out = _stage_rows(connection, manifest, directory, number)
                _stage_files(staged, manifest, directory)
            except BaseException:
                with suppress(StorageError):
                    staged.discard()
                raise
            _commit(connection, staged, number)
    try:
        Store(settings).close()
    except (SQLAlchemyError, StorageError, OSError) as error:
        raise AdminError(
            f"the backup is restored, but its files are not in place yet ({_reason(error)}); the "
            "next start of the service or `foldback admin list` moves them."
        ) from None
    return Restored(manifest, len(left_out))


def _stage_rows(
    connection: sa.Connection, manifest: Manifest, directory: Path, number: int
) -> Collection[str]:
    """Replace the rows within a transaction; return the ids of the folds that are left out."""
    drop_schema(connection)
    upgrade(connection, manifest.schema)
    with open_inside(directory, ROWS) as source:
        left_out = load_rows(connection, source, (file.name for file in manifest.files))
    connection.execute(sa.insert(CounterRow).values(name=RESTORED_COUNTER, value=number))
    return left_out


def _stage_files(staged: StagedFiles, manifest: Manifest, directory: Path) -> None:
    def stage(file: BackupFile) -> None:
        with open_inside(directory, file.name) as source:
            staged.write(file.name, source)

    at_once(stage, manifest.files)
    staged.complete()


def _commit(connection: sa.Connection, staged: StagedFiles, number: int) -> None:
    """Commit the transaction; delete the staged files if it has certainly not taken effect."""
    try:
        connection.commit()
    except SQLAlchemyError:
        with suppress(SQLAlchemyError, StorageError):
            connection.rollback()
            if restored_number(connection) != number:
                staged.discard()
        raise


@contextmanager
def _unchanged() -> Generator[None]:
    """Turn an error of a disk, a database or a storage into one that says that nothing changed."""
    try:
        yield
    except (SQLAlchemyError, StorageError, OSError) as error:
        raise AdminError(
            f"the backup cannot be restored ({_reason(error)}); nothing was changed."
        ) from error


def _reason(error: Exception) -> str:
    if isinstance(error, OSError):
        return f"{error.filename or 'a file'}: {error.strerror}"
    error_text = str(error.orig if isinstance(error, DBAPIError) else error)
    return error_text.strip().partition("\n")[0].removesuffix(".")


def _make_empty(directory: Path) -> None:
    directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    if any(directory.iterdir()):
        raise AdminError(
            f"got the directory {directory}, which is not empty; name a new one, because a backup "
            "never overwrites files."
        )
    with suppress(PermissionError):  # the directory belongs to another user
        directory.chmod(0o700)


def _make_private(path: Path) -> Path:
    """Create an empty file that only this user can access."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600))
    return path


def _save(stored: StoredFiles, name: str, directory: Path) -> BackupFile | None:
    """Copy a stored file into a backup; return None if it has been deleted meanwhile."""
    target = _make_private(directory / name)
    if not stored.save(name, target):
        target.unlink()
        return None
    target.chmod(0o600)
    return _described(directory, name)


def _described(directory: Path, name: str) -> BackupFile:
    with open_inside(directory, name) as file:
        return BackupFile.of(name, file)


def _read(directory: Path) -> Manifest:
    try:
        with open_inside(directory, MANIFEST) as file:
            manifest = Manifest.read(file.read(MAX_MANIFEST_BYTES + 1))
    except OSError:
        raise AdminError(
            f"got no {MANIFEST} in {directory}, expected a complete backup; create one with "
            "`foldback admin backup`."
        ) from None
    known_versions = Schema.of(None).known_versions
    if manifest.schema not in known_versions:
        raise AdminError(
            f"got a backup with rows of version {manifest.schema}, expected at most "
            f"{known_versions[-1]}; "
            f"install foldback {manifest.foldback}, which made the backup."
        )
    return manifest


def _check_storage(manifest: Manifest, stored: StoredFiles) -> None:
    """Refuse a backup of a service whose files are stored in another way."""
    if manifest.storage != stored.kind:
        raise AdminError(
            f"got a backup with the storage '{manifest.storage}', expected '{stored.kind}'; set "
            "FOLDBACK_STORAGE_URL to the value that it had when the backup was made."
        )


def _check_space(settings: Settings, manifest: Manifest) -> None:
    """Refuse a backup that does not fit on the disks of this machine beside the old data."""
    blocks = sum(-(-file.bytes // BLOCK_BYTES) for file in manifest.files)
    needs: list[tuple[Path, int]] = []
    if settings.storage_url is None:
        needs.append((settings.folds_dir, blocks * BLOCK_BYTES))
    if settings.store_url.startswith("sqlite"):
        path = Path(sa.make_url(settings.store_url).database or "")
        # rows with their indexes, twice: log and database
        needs.append((path.parent, 4 * manifest.rows.bytes))
    needed: Counter[int] = Counter()
    for path, size in needs:
        disk = path.stat().st_dev
        needed[disk] += size
        if (free := free_space(path)) < needed[disk]:
            raise AdminError(
                f"got {free >> 20} MiB of free space at {path}, expected "
                f"{(needed[disk] >> 20) + 1} MiB, because a backup is stored beside the old data "
                "first; free some space. Nothing was restored."
            )


def _check_digests(manifest: Manifest, directory: Path) -> None:
    def is_damaged(file: BackupFile) -> bool:
        try:
            return _described(directory, file.name) != file
        except OSError:
            return True

    files = (manifest.rows, *manifest.files)
    checked_files = zip(files, at_once(is_damaged, files), strict=True)
    damaged = [file.name for file, wrong in checked_files if wrong]
    if damaged:
        raise AdminError(
            f"got a backup with damaged files ({len(damaged)} in all), such as "
            f"{damaged[0]!r}, which is missing, changed or a symbolic link; use another backup. "
            "Nothing was restored."
        )
