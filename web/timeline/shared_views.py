"""Shared views: open timeline views by path, shared while they are in use."""

from __future__ import annotations

import threading
import weakref
from collections import OrderedDict
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from foldback.planner.errors import DamagedError, TimelineError
from foldback.web.timeline.view import TimelineView

MAX_VIEW_CACHE_BYTES: Final = 192 * 2**20
"""Maximum memory of all opened motions, in bytes. To open one again its summary of all frames has
to be read, so a smaller value makes pages slower."""


@contextmanager
def unless_replaced(*error_types: type[Exception]) -> Generator[None]:
    """Suppress the error of a missing timeline, or of one being replaced, but not of a damaged one.

    Args:
        error_types: Further exceptions that mean the same.
    """
    try:
        yield
    except DamagedError:
        raise
    except (TimelineError, *error_types):
        return


class TimelineViews:
    """Open timeline views by path, shared while they are in use. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._views: weakref.WeakValueDictionary[str, TimelineView] = weakref.WeakValueDictionary()
        self._opening: weakref.WeakValueDictionary[str, threading.Lock] = (
            weakref.WeakValueDictionary()
        )
        self._recent: OrderedDict[str, TimelineView] = OrderedDict()

    def get(self, timeline: Path) -> TimelineView | None:
        """Return the view of a timeline, or None when there is none yet.

        Raises:
            DamagedError: If it is damaged.
        """
        key = str(timeline)
        with self._lock:
            view = self._views.get(key)
            opening = self._opening.setdefault(key, threading.Lock())
        if view is None:
            view = self._opened(key, opening)
            if view is None:
                return None
        view.refresh()
        self._keep(key, view)
        return view

    def _opened(self, key: str, opening: threading.Lock) -> TimelineView | None:
        with opening:  # one lock per view: requests for other views do not wait
            with self._lock:
                view = self._views.get(key)
            if view is None:
                with unless_replaced(OSError, ValueError, KeyError):
                    view = TimelineView(key)
                    with self._lock:
                        self._views[key] = view
            return view

    def _keep(self, key: str, view: TimelineView) -> None:
        with self._lock:
            self._recent[key] = view
            self._recent.move_to_end(key)
            held_bytes = sum(kept_view.nbytes for kept_view in self._recent.values())
            while len(self._recent) > 1 and (
                len(self._recent) > 512 or held_bytes > MAX_VIEW_CACHE_BYTES
            ):
                held_bytes -= self._recent.popitem(last=False)[1].nbytes
