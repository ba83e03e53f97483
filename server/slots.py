"""Slots: the names of the workers on this machine, each held by at most one living process."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Iterable
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path
from typing import IO, Final

from planner.files import write_whole
from server.settings import Settings

MOST_WORKERS: Final = 256


class Slots:
    """The slots of one data directory: a name and a lock for each worker."""

    def __init__(self, settings: Settings) -> None:
        self._directory = settings.root / "workers"
        self._directory.mkdir(parents=True, exist_ok=True)
        # Machines may have the same name, as containers of the same image do.
        mark = self._directory / "id"
        if not mark.exists():
            with open(self._directory / "id.lock", "w") as lock:
                flock(lock, LOCK_EX)
                if not mark.exists():
                    write_whole(mark, secrets.token_hex(4).encode())
        self._prefix = f"{socket.gethostname()[:100]}/{mark.read_text()}/"

    def take(self) -> Slot:
        """The slot of the lowest number whose lock nobody holds.

        Raises:
            RuntimeError: When all are taken.
        """
        for number in range(MOST_WORKERS):
            lock = _lock(self._path(number))
            if lock is not None:
                return Slot(f"{self._prefix}{number}", lock)
        raise RuntimeError(f"found {MOST_WORKERS} workers on {self._directory}, expected fewer.")

    def dead(self, names: Iterable[str]) -> set[str]:
        """Those of the names that are of this machine and that no living worker holds."""
        found: set[str] = set()
        for name in names:
            number = name.removeprefix(self._prefix)
            if number == name or not number.isdecimal():
                continue
            lock = _lock(self._path(int(number)))
            if lock is not None:
                lock.close()
                found.add(name)
        return found

    def _path(self, number: int) -> Path:
        return self._directory / f"{number}.lock"


class Slot:
    """One worker's name, the same after every start in the same slot; held by its process."""

    def __init__(self, name: str, lock: IO[str]) -> None:
        self.name = name
        self._lock = lock

    def close(self) -> None:
        """Gives the name back."""
        self._lock.close()


def _lock(path: Path) -> IO[str] | None:
    file = open(path, "w")  # noqa: SIM115 (a slot's lock is held for the life of the process)
    try:
        flock(file, LOCK_EX | LOCK_NB)
    except BlockingIOError:
        file.close()
        return None
    return file
