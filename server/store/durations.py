"""Durations: how long the stages of folds took that ended in this database."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import sqlalchemy as sa

from server.store.folds import Store, cost_of
from server.store.tables import REQUESTED_COLUMNS, FoldRow

MAX_COMPARED_FOLDS: Final = 100
"""Maximum number of latest folds with the same options whose durations are read to estimate that of
another fold. A larger value is steadier, slower, and follows changes of the machine later.
Chosen."""
SIMILAR_SIZE_RATIO: Final = 1.5
"""Ratio of numbers of modules at which an earlier fold weighs 0.61 in the estimated duration of
another one (one standard deviation of a Gaussian in the logarithm). With a larger value folds of
other sizes count more. Chosen."""
MAX_SIZE_RATIO: Final = 4.0
"""Largest ratio of numbers of modules at which an earlier fold counts in the estimated duration of
another one. With a larger value more estimates are possible, and they are less accurate. Chosen."""

MIN_SIMILAR_FOLDS: Final = 3
"""Minimum number of earlier folds of similar size from which a duration is estimated. With a
smaller value one slow fold decides the estimate; with a larger one new kinds of folds have no
estimate for longer. Chosen."""
KIND_COLUMNS: Final = (
    "module",
    *(name for name in REQUESTED_COLUMNS if name not in ("seed", "module_size")),
)
"""Columns of a fold's row in which folds are alike whose durations are compared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Duration:
    """Computing time of one fold.

    Attributes:
        modules: Number of modules of its chain.
        stage_s: Seconds by stage, summed if a stage was repeated.
    """

    modules: int
    stage_s: dict[str, float]


def durations_like(store: Store, row: FoldRow) -> list[Duration]:
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
        .limit(MAX_COMPARED_FOLDS)
    )
    found = store.rows(query)
    return [
        Duration(modules=modules, stage_s=progress["stage_s"])
        for modules, progress in found
        if modules > 0 and progress.get("stage_s")
    ]


def typical_s(known: Sequence[Duration], row: FoldRow) -> dict[str, float] | None:
    """Return the expected seconds of each stage; None if fewer than ``MIN_SIMILAR_FOLDS``.

    Of each stage it is the median over other folds, weighted by the similarity of their sizes, each
    scaled by the expected costs of the two chains.
    """
    if row.modules <= 0:
        return None
    cost_s = cost_of(row, row.modules).expected_s
    weighed: list[tuple[float, Duration]] = []
    for duration in known:
        apart = abs(math.log(row.modules / duration.modules))
        if apart <= math.log(MAX_SIZE_RATIO):
            weighed.append((math.exp(-0.5 * (apart / math.log(SIMILAR_SIZE_RATIO)) ** 2), duration))
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
