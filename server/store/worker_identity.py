"""Worker identities: names of the workers on this machine, each held by at most one process.

A worker holds a name by the lock of an open file (OFD lock). Observers ask the kernel if the lock
is held and never take it, so that a worker that starts at this moment gets its name.
"""

from __future__ import annotations

import errno
import os
import secrets
import socket
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from fcntl import F_OFD_GETLK, F_OFD_SETLK, F_UNLCK, F_WRLCK, LOCK_EX, fcntl, flock
from pathlib import Path
from typing import IO, Final

from foldback.planner.storage.files import write_whole
from foldback.server.settings import Settings

MAX_WORKERS_PER_MACHINE: Final = 256
"""Maximum number of workers on one machine: each takes the first free number, and one that finds
none fails to start."""
WHOLE_FILE_LOCK: Final = struct.pack("hhqqi0q", F_WRLCK, os.SEEK_SET, 0, 0, 0)
"""The kernel's ``struct flock`` for a write lock on a whole file (fcntl(2)), in binary form: type,
whence, start, length, pid."""


class WorkerIdentities:
    """Identities of one data directory: a name and a lock for each worker."""

    def __init__(self, settings: Settings) -> None:
        self._directory = settings.root / "workers"
        # Different machines may have the same name, such as containers of one image.
        mark = self._directory / "id"
        if not mark.exists() and not settings.read_only:
            self._directory.mkdir(parents=True, exist_ok=True)
            with open(self._directory / "id.lock", "w") as lock:
                flock(lock, LOCK_EX)
                if not mark.exists():
                    write_whole(mark, secrets.token_hex(4).encode())
        stored_name = mark.read_text() if mark.exists() else ""
        self._prefix = f"{socket.gethostname()[:100]}/{stored_name}/"

    def take(self) -> WorkerIdentity:
        """Take the identity of the lowest free number.

        Raises:
            RuntimeError: If all are taken.
        """
        for number in range(MAX_WORKERS_PER_MACHINE):
            lock = _lock(self._path(number))
            if lock is not None:
                return WorkerIdentity(f"{self._prefix}{number}", lock)
        raise RuntimeError(
            f"found {MAX_WORKERS_PER_MACHINE} workers on {self._directory}, which is the limit; "
            "stop one first."
        )

    def dead(self, names: Iterable[str]) -> set[str]:
        """Return the names of this machine that no live worker holds."""
        worker_names: set[str] = set()
        for name in names:
            number = name.removeprefix(self._prefix)
            if number == name or not number.isdecimal():
                continue
            if not _locked(self._path(int(number))):
                worker_names.add(name)
        return worker_names

    def _path(self, number: int) -> Path:
        return self._directory / f"{number}.lock"


@dataclass(frozen=True, slots=True)
class WorkerIdentity:
    """Name of one worker, which stays the same after a restart.

    Attributes:
        name: The name.
        lock: File that is open and locked as long as a process holds the name.
    """

    name: str
    lock: IO[str]


def _lock(path: Path) -> IO[str] | None:
    file = open(path, "w")  # noqa: SIM115 (the lock is held for the life of the process)
    try:
        fcntl(file, F_OFD_SETLK, WHOLE_FILE_LOCK)
    except OSError as error:
        file.close()
        if error.errno in (errno.EAGAIN, errno.EACCES):
            return None
        raise
    return file


def _locked(path: Path) -> bool:
    """Return True if a live process holds the lock of a file; the lock is not taken."""
    try:
        with open(path) as file:
            lock = fcntl(file, F_OFD_GETLK, WHOLE_FILE_LOCK)
    except FileNotFoundError:
        return False
    return struct.unpack_from("h", lock)[0] != F_UNLCK
