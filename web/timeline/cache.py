"""Caches: recently read or computed values, bounded by their size."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from contextlib import suppress
from pathlib import Path
from typing import Generic, TypeVar

from cachetools import LRUCache

Thing = TypeVar("Thing")


class Cache(Generic[Thing]):
    """Least-recently-used values by key. Thread-safe.

    Args:
        most_bytes: Maximum total size of all values, bytes; a larger value is not stored.
        size: Returns the size of a value, bytes.
    """

    def __init__(self, most_bytes: int, size: Callable[[Thing], int]) -> None:
        self._lock = threading.Lock()
        self._things: LRUCache[Hashable, Thing] = LRUCache(most_bytes, size)

    def get(self, key: Hashable) -> Thing | None:
        """Return the value stored under a key, or None."""
        with self._lock:
            return self._things.get(key)

    def keep(self, key: Hashable, thing: Thing) -> None:
        """Store a value under its key."""
        with self._lock, suppress(ValueError):  # the value is too large
            self._things.pop(key, None)
            self._things[key] = thing

    def get_or_make(self, key: Hashable, make: Callable[[], Thing]) -> Thing:
        """Return the value stored under a key, or compute and store it."""
        thing = self.get(key)
        if thing is None:
            thing = make()
            self.keep(key, thing)
        return thing

    @property
    def nbytes(self) -> int:
        """Total size of all values, bytes."""
        return int(self._things.currsize)

    def clear(self) -> None:
        """Remove all values."""
        with self._lock:
            self._things.clear()


def version_of(path: Path) -> tuple[Path, int, int]:
    """Return a key that changes when a file is replaced or written.

    Raises:
        OSError: If there is no such file.
    """
    stat = path.stat()
    return path, stat.st_ino, stat.st_mtime_ns
