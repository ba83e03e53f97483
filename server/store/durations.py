"""Durations: how long the stages of folds took that ended in this database."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import sqlalchemy as sa

from server.store.folds import Store, cost_of
from server.store.tables import FoldRow

LATEST: Final = 100
"""Folds of one kind that are looked at."""
NEAR: Final = 1.5
"""Factor in modules by which the weight of another fold falls to 0.6."""
FARTHEST: Final = 4.0
"""Factor in modules from which on another fold says nothing."""

MIN_SAMPLES: Final = 3
"""Minimum number of similar folds for an estimate. With a smaller value one slow fold decides it;
with a larger one new kinds of folds stay without an estimate for longer. Chosen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Duration:
    """How long one fold took.

    Attributes:
        modules: Of its chain.
        stage_s: Seconds by stage; of one that was gone through again, all together.
    """

    modules: int
    stage_s: dict[str, float]


def durations_like(store: Store, row: FoldRow) -> list[Duration]:
    """Of the latest verified folds that were computed in the same way, whatever their modules."""
    alike = (
        FoldRow.module == row.module,
        FoldRow.preset == row.preset,
        FoldRow.strategy == row.strategy,
        FoldRow.prefer == row.prefer,
        FoldRow.world == row.world,
        FoldRow.settings == row.settings,
        FoldRow.smooths.is_(None) if row.smooths is None else FoldRow.smooths.is_not(None),
        FoldRow.refold.is_(None) if row.refold is None else FoldRow.refold.is_not(None),
    )
    query = (
        sa.select(FoldRow.modules, FoldRow.progress)
        .where(FoldRow.status == "verified", *alike)
        .order_by(FoldRow.created_at.desc())
        .limit(LATEST)
    )
    with store.reading() as session:
        found = session.execute(query).all()
    return [
        Duration(modules=modules, stage_s=progress["stage_s"])
        for modules, progress in found
        if modules > 0 and progress.get("stage_s")
    ]


def typical_s(known: Sequence[Duration], row: FoldRow) -> dict[str, float] | None:
    """Return the expected seconds of each stage; None below ``MIN_SAMPLES`` folds of its size.

    Of each stage it is the median over other folds, those of nearly as many modules counting most,
    each stretched by what a chain of so many modules is expected to cost.
    """
    if row.modules <= 0:
        return None
    cost_s = cost_of(row, row.modules).expected_s
    weighed: list[tuple[float, Duration]] = []
    for duration in known:
        apart = abs(math.log(row.modules / duration.modules))
        if apart <= math.log(FARTHEST):
            weighed.append((math.exp(-0.5 * (apart / math.log(NEAR)) ** 2), duration))
    if len(weighed) < MIN_SAMPLES:
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
    """The value that half of the weight lies below."""
    half = 0.5 * sum(weight for _, weight in weighed)
    so_far = 0.0
    for value, weight in sorted(weighed):
        so_far += weight
        if so_far >= half:
            return value
    return weighed[-1][0]
