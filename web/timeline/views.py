"""Films: open films by path, shared while anybody looks."""

from __future__ import annotations

import threading
import weakref
from collections import OrderedDict
from pathlib import Path
from typing import Final

from planner.errors import TimelineError
from web.timeline.view import Film

MOST_KEPT: Final = 512
MOST_BYTES: Final = 192 * 2**20
"""Of films kept open though nobody may be looking: opening one reads its whole summary."""


class Films:
    """See the module's description. Safe to use from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._films: weakref.WeakValueDictionary[str, Film] = weakref.WeakValueDictionary()
        self._opening: weakref.WeakValueDictionary[str, threading.Lock] = (
            weakref.WeakValueDictionary()
        )
        self._kept: OrderedDict[str, Film] = OrderedDict()

    def get(self, timeline: Path) -> Film | None:
        """The film of a timeline, or None when there is none yet."""
        key = str(timeline)
        with self._lock:
            film = self._films.get(key)
            opening = self._opening.setdefault(key, threading.Lock())
        if film is None:
            film = self._opened(key, opening)
            if film is None:
                return None
        film.refresh()
        self._keep(key, film)
        return film

    def _opened(self, key: str, opening: threading.Lock) -> Film | None:
        with opening:  # whoever wants another film need not wait
            with self._lock:
                film = self._films.get(key)
            if film is None:
                try:
                    film = Film(key)
                except (TimelineError, OSError, ValueError, KeyError):
                    return None
                with self._lock:
                    self._films[key] = film
            return film

    def _keep(self, key: str, film: Film) -> None:
        with self._lock:
            self._kept[key] = film
            self._kept.move_to_end(key)
            held = sum(kept.nbytes for kept in self._kept.values())
            while len(self._kept) > 1 and (len(self._kept) > MOST_KEPT or held > MOST_BYTES):
                held -= self._kept.popitem(last=False)[1].nbytes
