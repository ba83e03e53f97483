"""Estimates: the one source of how long a fold takes, for previews, folds and comparisons.

The stages of similar folds that ended in this database are measured. Below ``MIN_SAMPLES`` of them
the planner's expected cost stands in.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from operator import attrgetter
from typing import Final

from cachetools import TTLCache, cachedmethod

from planner.pipeline.request import FoldRequest
from server.store.durations import KIND_COLUMNS, Duration, durations_like, typical_s
from server.store.folds import Store, cost_of
from server.store.tables import FoldRow, columns_of

DURATIONS_CACHE_S: Final = 5.0
"""Time for which durations of earlier folds are cached, in s. A larger value includes the newest
folds in estimates later; a smaller one reads the database more often. Chosen."""
MAX_CACHED_KINDS: Final = 1024
"""Maximum number of kinds of folds (combinations of options) whose durations are cached. A smaller
value reads the database more often. Chosen."""
DEFAULT_STAGE_FRACTIONS: Final = {
    "read": 0.05,
    "explode": 0.15,
    "play_back": 0.6,
    "certify": 0.15,
    "export": 0.05,
}
"""Fractions of a fold's expected duration by stage, for estimates while no similar fold was
measured. With too small a fraction a stage counts as late too early. Measured: tori of 160 cubes
took 0.5 to 2.5 s (explode), 5 to 10 s (play back) and 1 to 2 s (certify)."""

Expected = Callable[[FoldRow], float]
"""Returns the seconds that a fold is expected to take."""


def plain_fold(modules: int, request: FoldRequest) -> FoldRow:
    """Return the row of a fold that no client has requested, to estimate its time."""
    columns = columns_of(request)
    return FoldRow(modules=modules, module=request.module, smooths=None, refold=None, **columns)


def expected_of_cost(row: FoldRow) -> float:
    """Return the planner's expected cost of a fold, in seconds."""
    return cost_of(row).expected_s


def _kind_of(_estimates: Estimates, row: FoldRow) -> tuple[object, ...]:
    """Return in what folds are alike whose durations are compared."""
    return (*(getattr(row, name) for name in KIND_COLUMNS), row.smooths is None, row.refold is None)


class Estimates:
    """Expected times of folds. Safe to use from many threads.

    Args:
        store: Rows of the folds.
        clock: Seconds since 1970.
    """

    def __init__(self, store: Store, *, clock: Callable[[], float] = time.time) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._measured: TTLCache[tuple[object, ...], list[Duration]] = TTLCache(
            MAX_CACHED_KINDS, DURATIONS_CACHE_S, timer=clock
        )

    def stages_s(self, row: FoldRow) -> dict[str, float] | None:
        """Return the expected seconds of each stage; None while the modules are not counted."""
        if row.modules <= 0:
            return None
        measured = typical_s(self._like(row), row)
        if measured is not None:
            return measured
        whole_s = expected_of_cost(row)
        return {stage: share * whole_s for stage, share in DEFAULT_STAGE_FRACTIONS.items()}

    def total_s(self, row: FoldRow) -> float:
        """Return the expected seconds of a whole fold without its wait; 0 without modules."""
        return sum((self.stages_s(row) or {}).values())

    @cachedmethod(attrgetter("_measured"), _kind_of, lock=attrgetter("_lock"))
    def _like(self, row: FoldRow) -> list[Duration]:
        return durations_like(self._store, row)
