"""Kept: what was read or made lately, bounded by its size."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable
from typing import Generic, TypeVar

Thing = TypeVar("Thing")


class Kept(Generic[Thing]):
    """Keeps what was asked for lately under its key. Safe to use from several threads.

    Args:
        most_bytes: Of all things together; one that is larger is not kept.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._lock = threading.Lock()
        self._things: OrderedDict[Hashable, tuple[Thing, int]] = OrderedDict()
        self._bytes = 0

    def get(self, key: Hashable) -> Thing | None:
        """What is kept under a key, or None."""
        with self._lock:
            found = self._things.get(key)
            if found is None:
                return None
            self._things.move_to_end(key)
            return found[0]

    def keep(self, key: Hashable, thing: Thing, size: int) -> None:
        """Keeps a thing of ``size`` bytes in place of what was under its key."""
        with self._lock:
            _, before = self._things.pop(key, (None, 0))
            self._bytes -= before
            if size > self._most_bytes:
                return
            self._things[key] = (thing, size)
            self._bytes += size
            while self._bytes > self._most_bytes:
                _, (_, least) = self._things.popitem(last=False)
                self._bytes -= least
