"""Films: open films by path, shared while anybody looks."""

from __future__ import annotations

import threading
import weakref
from collections import OrderedDict
from pathlib import Path
from typing import Final

from planner.errors import TimelineError
from web.film import Film

KEPT: Final = 8
"""Films kept open though nobody may be looking: opening one reads its whole summary."""


class Films:
    """See the module's description. Safe to use from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._films: weakref.WeakValueDictionary[str, Film] = weakref.WeakValueDictionary()
        self._kept: OrderedDict[str, Film] = OrderedDict()

    def get(self, timeline: Path) -> Film | None:
        """The film of a timeline, or None when there is none yet."""
        key = str(timeline)
        with self._lock:
            film = self._films.get(key)
            if film is None:
                try:
                    film = Film(timeline)
                except (TimelineError, OSError, ValueError, KeyError):
                    self._kept.pop(key, None)
                    return None
                self._films[key] = film
            self._kept[key] = film
            self._kept.move_to_end(key)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        film.refresh()
        return film
