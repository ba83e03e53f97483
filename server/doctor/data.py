"""Checks of the data: directory and disk, database, storage."""

from __future__ import annotations

import os
import time
from contextlib import closing
from pathlib import Path
from typing import Final

import psutil
import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from foldback.planner.storage.files import READ_ONLY_ERRORS
from foldback.server.doctor.check_result import CheckResult, ok, problem, warning
from foldback.server.errors import READ_ONLY_WORDS
from foldback.server.limits.disk_space import free_space
from foldback.server.ops.readiness import check_folder
from foldback.server.settings import Settings
from foldback.server.store.object_store import open_storage
from foldback.server.store.schema import (
    PoolerError,
    check_sessions,
    missing_database,
    reading_connection,
)
from foldback.server.store.schema_version import Schema
from foldback.server.store.staged_files import restored_number

NETWORK_FILESYSTEMS: Final = frozenset(
    {"nfs", "nfs4", "cifs", "smb3", "smbfs", "fuse.sshfs", "9p", "afs"}
)
VOLATILE_FILESYSTEMS: Final = frozenset({"tmpfs", "ramfs"})


def directory(settings: Settings) -> CheckResult:
    """Check that the data directory is writable; report its disk and free space."""
    root = settings.root
    existing = _nearest(root)
    try:
        check_folder(existing)
    except OSError as error:
        text = f"{existing} cannot be written ({error.strerror})"
        if error.errno in READ_ONLY_ERRORS:
            text += f". {READ_ONLY_WORDS[:-1]}"
        return problem(
            text,
            "Make the directory writable for the user that runs foldback, or set FOLDBACK_DATA_DIR "
            "to another directory.",
        )
    kind = _kind_of_disk(existing)
    free = free_space(existing)
    text = f"{root} on {kind}, {free // 2**20} MiB free"
    if root != existing:
        text += "; it will be created"
    if free < settings.min_free_disk_bytes:
        return problem(
            f"{text}, expected at least {settings.min_free_disk_bytes // 2**20} MiB",
            "Free some space (`foldback admin expire --older DAYS`), or use a larger disk.",
        )
    if kind in NETWORK_FILESYSTEMS and settings.database_url is None:
        return warning(
            f"{text}; SQLite is not safe on a network disk",
            "Use a local disk, or PostgreSQL with FOLDBACK_DATABASE_URL.",
        )
    if kind in VOLATILE_FILESYSTEMS:
        return warning(
            f"{text}; its content is lost when the machine restarts",
            "Set FOLDBACK_DATA_DIR to a directory on a disk.",
        )
    return ok(text)


def _nearest(path: Path) -> Path:
    """Return the directory, or its nearest existing parent."""
    while not path.exists() and path != path.parent:
        path = path.parent
    return path


def _kind_of_disk(path: Path) -> str:
    real = os.path.realpath(path)
    disks = [
        disk
        for disk in psutil.disk_partitions(all=True)
        if os.path.commonpath([real, disk.mountpoint]) == disk.mountpoint
    ]
    return max(disks, key=lambda disk: len(disk.mountpoint)).fstype if disks else "unknown"


def database(settings: Settings) -> CheckResult:
    """Check that the database answers and has a schema of a known version."""
    url = settings.store_url
    if (missing := missing_database(url)) is not None:
        return ok(f"{missing} will be created")
    try:
        with reading_connection(url) as connection:
            if connection.dialect.name == "postgresql":
                check_sessions(url)
            return _schema(url, connection)
    except PoolerError as error:
        return problem(
            f"{_shown(url)}: {error}",
            "Set FOLDBACK_DATABASE_URL to the address of PostgreSQL, or let the pooler keep a "
            "session for each connection.",
        )
    except (SQLAlchemyError, ModuleNotFoundError) as error:
        return _unusable(url, error)


def _schema(url: str, connection: sa.Connection) -> CheckResult:
    schema = Schema.of(connection)
    ahead_s = _ahead_s(connection, schema)
    text = f"{_shown(url)}, version {schema.version}"
    if schema.newer:
        return problem(
            f"{text}, from a newer foldback; this foldback supports versions up to {schema.head}",
            "Install the newer version again, or restore an older backup.",
        )
    if schema.version is None:
        return ok(f"{_shown(url)}, empty; it will be set up")
    if schema.missing:
        return warning(
            f"{text}, expected {schema.head}",
            "Back up the database before you start `foldback serve`, which updates it.",
        )
    if restored_number(connection) is not None:
        return warning(
            f"{text}, with an unfinished restore",
            "Start the service or run `foldback admin list` to finish it. If the restored files "
            "are lost, restore the backup again.",
        )
    if ahead_s > 5.0:
        return warning(
            f"{text}; its times and this machine's clock are {ahead_s:.0f} s apart",
            "Set this machine's clock and the database's clock with NTP.",
        )
    return ok(text)


def storage(settings: Settings) -> CheckResult:
    """Check that files of folds can be written, read, listed and deleted."""
    place = settings.storage_url or str(settings.folds_dir)
    if settings.storage_url is None and not settings.folds_dir.exists():
        return ok(f"{place} will be created")
    try:
        _check_storage(settings)
    except Exception as error:  # storages raise different types of errors
        if settings.storage_url is None:
            remedy = "Make the directory writable for the user that runs foldback."
        else:
            remedy = "Check FOLDBACK_STORAGE_URL, the AWS_… variables and the bucket's policy."
        words = str(error).partition("\n")[0][:200]
        return problem(f"{place} cannot be used ({type(error).__name__}: {words})", remedy)
    return ok(f"{place}; a test file was written, read and deleted")


def _check_storage(settings: Settings) -> None:
    opened = open_storage(settings)
    if opened is None:
        check_folder(settings.folds_dir)
        return
    with closing(opened):
        opened.check()


def _ahead_s(connection: sa.Connection, schema: Schema) -> float:
    """Return the seconds by which the database's clock differs, or its newest row is ahead."""
    if connection.dialect.name == "postgresql":
        database_s = connection.scalar(sa.text("SELECT extract(epoch FROM clock_timestamp())"))
        return abs(float(database_s) - time.time())
    if schema.version is None:
        return 0.0
    newest = connection.scalar(sa.text("SELECT max(created_at) FROM folds"))
    return max(0.0, float(newest or 0.0) - time.time())


def _shown(url: str) -> str:
    """Return the address without its password."""
    return sa.make_url(url).render_as_string(hide_password=True)


def _unusable(url: str, error: Exception) -> CheckResult:
    cause = getattr(error, "orig", None) or error
    words = str(cause).strip().partition("\n")[0][:200]
    if "not a database" in words or "malformed" in words:
        remedy = "Move the file away and restore a backup, or start with an empty database."
    else:
        remedy = "Start the database, or check FOLDBACK_DATABASE_URL."
    return problem(f"{_shown(url)} cannot be used ({words})", remedy)
