"""Estimates: expected computing times of folds, for previews, queue and comparisons.

Estimates use the measured stages of similar folds in the database. If there are fewer than
``MIN_SIMILAR_FOLDS``, they use the planner's expected cost.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

import sqlalchemy as sa
from cachetools import TTLCache, cachedmethod

from foldback.planner.pipeline.request import FoldRequest
from foldback.server.store.folds import Store, cost_of
from foldback.server.store.schema import REQUESTED_COLUMNS, FoldRow, columns_of

MIN_SIMILAR_FOLDS: Final = 3
"""Minimum number of earlier folds of similar size from which a duration is estimated."""
KIND_COLUMNS: Final = (
    "module",
    *(name for name in REQUESTED_COLUMNS if name not in ("seed", "module_size")),
)
"""Columns of a fold's row that must be equal for durations to be compared."""
DEFAULT_STAGE_FRACTIONS: Final = {
    "read": 0.05,
    "explode": 0.15,
    "play_back": 0.6,
    "certify": 0.15,
    "export": 0.05,
}
"""Fractions of a fold's expected duration by stage, for estimates while no similar fold was
measured. Measured: tori of 160 cubes took 0.5 to 2.5 s (explode), 5 to 10 s (play back) and 1 to 2
s (certify)."""

Expected = Callable[[FoldRow], float]
"""Function that returns the seconds that a fold is expected to take."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Duration:
    """Computing time of one fold.

    Attributes:
        modules: Number of modules of its chain.
        stage_s: Seconds by stage, summed if a stage was repeated.
    """

    modules: int
    stage_s: dict[str, float]


def plain_fold(modules: int, request: FoldRequest) -> FoldRow:
    """Return the row of a fold that no client has requested, to estimate its time."""
    columns = columns_of(request)
    return FoldRow(modules=modules, module=request.module, smooths=None, refold=None, **columns)


def expected_of_cost(row: FoldRow) -> float:
    """Return the planner's expected cost of a fold, in seconds."""
    return cost_of(row).expected_s


def _kind_of(_estimates: Estimates, row: FoldRow) -> tuple[object, ...]:
    """Return the properties of a fold that must be equal for durations to be compared."""
    return (*(getattr(row, name) for name in KIND_COLUMNS), row.smooths is None, row.refold is None)


class Estimates:
    """Expected times of folds. Safe for use by several threads.

    Args:
        store: Rows of the folds.
        clock: Seconds since 1970.
    """

    def __init__(self, store: Store, *, clock: Callable[[], float] = time.time) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._measured: TTLCache[tuple[object, ...], list[Duration]] = TTLCache(
            1024, 5.0, timer=clock
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
        """Return durations of the latest verified folds computed the same way, of any size."""
        alike = (
            *(getattr(FoldRow, name) == getattr(row, name) for name in KIND_COLUMNS),
            FoldRow.smooths.is_(None) if row.smooths is None else FoldRow.smooths.is_not(None),
            FoldRow.refold.is_(None) if row.refold is None else FoldRow.refold.is_not(None),
        )
        query = (
            sa.select(FoldRow.modules, FoldRow.progress)
            .where(FoldRow.status == "verified", *alike)
            .order_by(FoldRow.created_at.desc())
            .limit(100)
        )
        rows = self._store.rows(query)
        return [
            Duration(modules=modules, stage_s=progress["stage_s"])
            for modules, progress in rows
            if modules > 0 and progress.get("stage_s")
        ]


def typical_s(durations: Sequence[Duration], row: FoldRow) -> dict[str, float] | None:
    """Return the expected seconds of each stage; None if fewer than ``MIN_SIMILAR_FOLDS``.

    For each stage, this is the median over other folds, weighted by the similarity of their sizes.
    Each duration is scaled by the ratio of the expected costs of the two chains.
    """
    if row.modules <= 0:
        return None
    cost_s = cost_of(row, row.modules).expected_s
    weighed: list[tuple[float, Duration]] = []
    for duration in durations:
        apart = abs(math.log(row.modules / duration.modules))
        if apart <= math.log(4.0):
            # a Gaussian in the logarithm, of this standard deviation
            weighed.append((math.exp(-0.5 * (apart / math.log(1.5)) ** 2), duration))
    if len(weighed) < MIN_SIMILAR_FOLDS:
        return None
    typical: dict[str, float] = {}
    for stage in sorted({name for _, duration in weighed for name in duration.stage_s}):
        typical[stage] = _median(
            [
                (
                    duration.stage_s.get(stage, 0.0)
                    * cost_s
                    / cost_of(row, duration.modules).expected_s,
                    weight,
                )
                for weight, duration in weighed
            ]
        )
    return typical


def _median(weighed: list[tuple[float, float]]) -> float:
    """Return the weighted median."""
    half = 0.5 * sum(weight for _, weight in weighed)
    so_far = 0.0
    for value, weight in sorted(weighed):
        so_far += weight
        if so_far >= half:
            return value
    return weighed[-1][0]
