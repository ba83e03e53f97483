"""Backup and restoration of a service: rows first, then files.

A backup is a directory with a dump of the database, the stored files, and a manifest. Previews and
caches are not included.
"""

from __future__ import annotations

import os
import shutil
import time
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from planner.files import settle
from server.admin.backup_manifest import MANIFEST, BackupFile, Manifest
from server.admin.database import Database
from server.admin.errors import AdminError
from server.admin.migration import schema_of
from server.admin.stored_files import StoredFiles, at_once, open_inside, stored_files
from server.settings import Settings
from server.store.schema_version import Schema


def back_up(settings: Settings, directory: Path) -> Manifest:
    """Write a backup of a service, which may be running.

    Args:
        settings: The settings of the service.
        directory: Directory of the backup, empty or missing.

    Raises:
        AdminError: If there is nothing to back up, the directory is not empty, or a dump failed.
        SQLAlchemyError: If the database does not answer.
        StorageError: If the object store does not answer.
        OSError: If a file cannot be read or written.
    """
    schema = schema_of(settings)
    if schema.found is None:
        raise AdminError(
            f"got a database without tables for the data directory {settings.root}, expected "
            "tables to back up; check FOLDBACK_DATA_DIR and FOLDBACK_DATABASE_URL."
        )
    _make_empty(directory)
    created_at = time.time()
    database = Database(settings.store_url)
    database.dump(_make_private(directory / database.file))
    dump = _described(directory, database.file)
    with stored_files(settings) as stored:
        found = at_once(lambda name: _save(stored, name, directory), stored.names())
        files = [file for file in found if file is not None]
        manifest = Manifest(
            foldback=version("foldback"),
            created_at=created_at,
            schema=schema.found,
            storage=stored.kind,
            database=dump,
            files=tuple(files),
        )
    _make_private(directory / MANIFEST).write_bytes(manifest.text())
    settle(directory)
    return manifest


def restore(settings: Settings, directory: Path, *, replace: bool) -> Manifest:
    """Restore the state of a service from a backup. All its processes must be stopped.

    Every file of the backup is compared with its digest before anything changes.

    Args:
        settings: The settings of the service.
        directory: Directory of the backup.
        replace: True to delete and replace existing folds; otherwise they are an error.

    Raises:
        AdminError: If the backup is damaged or of another kind, or the service is not empty or
            runs.
        SQLAlchemyError: If the database does not answer.
        StorageError: If the object store does not answer.
        OSError: If a file cannot be written.
    """
    manifest = _read(directory)
    settings.make_directories()
    database = Database(settings.store_url)
    with stored_files(settings) as stored:
        _check_kinds(manifest, database, stored)
        _check_digests(manifest, directory)
        if not replace and not _is_empty(database, stored):
            raise AdminError(
                "got a service that already has data, expected an empty one; delete the data with "
                "--replace, or name an empty data directory, database and object store."
            )
        database.check_unused()
        with open_inside(directory, database.file) as source:
            database.restore(source)
        stored.replace((file.name for file in manifest.files), lambda n: open_inside(directory, n))
    for copies in (settings.work_dir, settings.cache_dir):  # copies of the replaced folds
        shutil.rmtree(copies, ignore_errors=True)
    settle(settings.root)
    return manifest


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
            manifest = Manifest.read(file.read())
    except OSError:
        raise AdminError(
            f"got no {MANIFEST} in {directory}, expected a complete backup; create one with "
            "`foldback admin backup`."
        ) from None
    known = Schema.of(None).known
    if manifest.schema not in known:
        raise AdminError(
            f"got a backup with tables of version {manifest.schema}, expected at most {known[-1]}; "
            f"install foldback {manifest.foldback}, which made the backup."
        )
    return manifest


def _check_kinds(manifest: Manifest, database: Database, stored: StoredFiles) -> None:
    """Refuse a backup of a service with another database or storage than this one."""
    got = (manifest.database.name, manifest.storage)
    expected = (database.file, stored.kind)
    if got != expected:
        raise AdminError(
            f"got a backup with the database file {got[0]} and the storage '{got[1]}', expected "
            f"{expected[0]} and '{expected[1]}'; set FOLDBACK_DATABASE_URL and "
            "FOLDBACK_STORAGE_URL to the values that they had when the backup was made."
        )


def _check_digests(manifest: Manifest, directory: Path) -> None:
    def is_damaged(file: BackupFile) -> bool:
        try:
            return _described(directory, file.name) != file
        except OSError:
            return True

    files = (manifest.database, *manifest.files)
    found = zip(files, at_once(is_damaged, files), strict=True)
    damaged = [file.name for file, wrong in found if wrong]
    if damaged:
        raise AdminError(
            f"got a backup with damaged files ({len(damaged)} in all), such as {damaged[0]}, which "
            "is missing, changed or a symbolic link; use another backup. Nothing was restored."
        )


def _is_empty(database: Database, stored: StoredFiles) -> bool:
    return database.is_empty() and next(stored.names(), None) is None
