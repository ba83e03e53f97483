"""Slots: the names of the workers on this machine, each held by at most one living process."""

from __future__ import annotations

import socket
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path
from typing import IO, Final

from server.settings import Settings

MOST_WORKERS: Final = 256


class Slot:
    """A worker's name: the lowest number whose lock nobody holds. Held until the process ends."""

    def __init__(self, settings: Settings) -> None:
        self._directory = _directory(settings)
        self._directory.mkdir(parents=True, exist_ok=True)
        for number in range(MOST_WORKERS):
            lock = _lock(self._directory / f"{number}.lock")
            if lock is not None:
                self._held = lock
                self.number = number
                return
        raise RuntimeError(f"found {MOST_WORKERS} workers on {self._directory}, expected fewer.")

    @property
    def name(self) -> str:
        """The same after every start in the same slot."""
        return _name(self.number)

    def dead(self) -> list[str]:
        """Names of the other slots that no living worker holds."""
        names: list[str] = []
        for path in self._directory.glob("*.lock"):
            number = int(path.stem)
            if number != self.number and (lock := _lock(path)) is not None:
                lock.close()
                names.append(_name(number))
        return names


def living(settings: Settings) -> int:
    """Number of workers that are alive on this machine."""
    alive = 0
    for path in _directory(settings).glob("*.lock"):
        lock = _lock(path)
        if lock is None:
            alive += 1
        else:
            lock.close()
    return alive


def _directory(settings: Settings) -> Path:
    return settings.root / "workers"


def _name(number: int) -> str:
    return f"{socket.gethostname()}/{number}"


def _lock(path: Path) -> IO[str] | None:
    file = open(path, "w")  # noqa: SIM115 (a slot's lock is held for the life of the process)
    try:
        flock(file, LOCK_EX | LOCK_NB)
    except BlockingIOError:
        file.close()
        return None
    return file
