"""Backups for tests: services without processes, and restores that end at a given moment."""

import errno
import hashlib
import multiprocessing
import os
import shutil
import signal
import sqlite3
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, NamedTuple

import obstore
import sqlalchemy as sa
from click.testing import Result
from sqlalchemy import event
from sqlalchemy.exc import OperationalError
from typer.testing import CliRunner

from foldback.server.admin.backup import restore
from foldback.server.admin.backup_rows import write_rows
from foldback.server.admin.database import consistent_view
from foldback.server.admin.errors import AdminError
from foldback.server.admin.stored_files import stored_files
from foldback.server.cli.admin import admin
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.staged_files import staged_numbers
from tests.server.rows import SOMEBODY, a_fold
from tests.server.service_thread import copy_schema

TIMEOUT_S = 60.0
REFUSED_CODE = 3
"""Exit code of a restore that has ended with a message."""
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
Fault = Literal["killed", "full"]
"""How a restore ends early: SIGKILL, or a disk, database or store that is full from then on."""
State = tuple[bytes, dict[str, str]]
"""Rows of a service, and the digest of each of its files."""


class Ended(NamedTuple):
    """End of a restore in another process: its exit code, and the number of moments until then."""

    code: int
    moments: int


@dataclass(frozen=True)
class Site:
    """Settings of one service, as keywords and as variables."""

    data_dir: Path
    database_url: str | None = None
    storage_url: str | None = None

    @property
    def settings(self) -> Settings:
        return _settings(self)

    def run(self, *arguments: str | Path) -> Result:
        set_variables = {
            f"FOLDBACK_{name.upper()}": str(value) for name, value in self.__dict__.items()
        }
        set_variables = {name: value for name, value in set_variables.items() if value != "None"}
        return CliRunner().invoke(admin, list(map(str, arguments)), env=set_variables)

    def add(self, fold_id: str, content: bytes = b"cells of ") -> None:
        """Add a queued fold with files."""
        directory = self.data_dir / f"aside-{fold_id}"
        (directory / "timeline").mkdir(parents=True)
        (directory / "input").write_bytes(content + fold_id.encode())
        (directory / "timeline" / "head.json").write_bytes(b"{}")
        copy_schema(self.settings)
        with closing(Store(self.settings)) as store:
            store.add(a_fold(fold_id, status="queued"), SOMEBODY)
            store.folders.adopt(directory, fold_id)
        shutil.rmtree(directory, ignore_errors=True)  # an object store has a copy

    def input_of(self, fold_id: str) -> bytes:
        with closing(Store(self.settings)) as store:
            return (store.directory(fold_id) / "input").read_bytes()

    def state(self) -> State:
        """Return all rows and files, as the next process that opens the store finds them."""
        settings = self.settings
        Store(settings).close()
        rows = BytesIO()
        with consistent_view(settings.store_url) as connection:
            write_rows(connection, rows)
        with stored_files(settings) as file_store, tempfile.TemporaryDirectory() as directory:
            copy = Path(directory) / "file"
            files: dict[str, str] = {}
            for name in file_store.names():
                copy.touch()
                assert file_store.save(name, copy)
                files[name] = hashlib.sha256(copy.read_bytes()).hexdigest()
        return b"".join(sorted(rows.getvalue().splitlines())), files

    def staged(self) -> set[int]:
        """Return the numbers of staged files."""
        with stored_files(self.settings) as stored:
            return set(staged_numbers(self.settings, stored.storage))

    def restore_until(self, copy: Path, moment: float, fault: Fault = "killed") -> Ended:
        """Restore a backup in another process, which ends early.

        Args:
            copy: The backup.
            moment: Number of the change of a file, of a statement or of a request to the object
                store, at which the fault occurs; or seconds after which the process is killed.
            fault: The fault.
        """
        counted = isinstance(moment, int)
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload([__name__])
        count = context.RawValue("q", 0)
        process = context.Process(
            target=_restore,
            args=(self, copy, dict(os.environ), moment if counted else sys.maxsize, fault, count),
        )
        process.start()
        process.join(TIMEOUT_S if counted else moment)
        if not counted:
            process.kill()
            process.join(TIMEOUT_S)
        assert process.exitcode is not None, "the restore does not end"
        return Ended(process.exitcode, count.value)


@cache  # each takes 3 ms
def _settings(site: Site) -> Settings:
    return Settings(**site.__dict__)


class _Moments:
    """Counts changes of files, statements and requests to the store; then the fault occurs."""

    def __init__(self, moment: int, fault: Fault, count: Any) -> None:
        self._moment, self._fault = moment, fault
        self._count = count
        self._lock = threading.Lock()

    def watch(self) -> None:
        sys.addaudithook(self._on_audit)
        event.listen(sa.Engine, "before_cursor_execute", lambda *_: self._on_statement())
        event.listen(sa.Engine, "commit", lambda *_: self._on_statement())
        for name in ("put", "copy", "delete", "list"):
            setattr(obstore, name, self._watched(getattr(obstore, name), name in ("put", "copy")))

    def _on_audit(self, name: str, arguments: tuple[Any, ...]) -> None:
        if name in ("os.rename", "os.remove", "os.rmdir"):
            self._on_change()
            return
        writes = name == "os.mkdir" or (name == "open" and arguments[2] & WRITING)
        if writes and self._on_change():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(arguments[0]))

    def _on_statement(self) -> None:
        if self._on_change():
            full = sqlite3.OperationalError("database or disk is full")
            raise OperationalError("INSERT", None, full)

    def _watched(self, function: Callable[..., Any], writes: bool) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            if self._on_change() and writes:
                raise OSError("the store is full")
            return function(*arguments, **named)

        return call

    def _on_change(self) -> bool:
        """Return True if there is no room any more."""
        with self._lock:
            self._count.value += 1
            is_over = self._count.value >= self._moment
        if is_over and self._fault == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        return is_over


def _restore(
    site: Site, copy: Path, environment: dict[str, str], moment: int, fault: Fault, count: Any
) -> None:
    os.environ.update(environment)
    _Moments(moment, fault, count).watch()
    try:
        restore(site.settings, copy, replace=True)
    except AdminError:
        os._exit(REFUSED_CODE)
    os._exit(0)
