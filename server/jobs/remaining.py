"""Remaining: how long a fold is likely to take from now on, by what was measured here.

What each stage takes is estimated by ``server.store.estimates``. The stage that runs also tells
which part of it is done: the farther it is, the more its own pace counts, and it is that of the
stages after it, too.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from cachetools import TTLCache

from planner.pipeline.preference import COMPUTING
from server.jobs.progress import STAGES, TRYING
from server.limits.fair_queue import wait_s
from server.store.estimates import Estimates
from server.store.folds import Store
from server.store.leases import Leases, Preparing
from server.store.tables import FoldRow

TOLD_KEPT_S: Final = 60.0
MOST_KEPT: Final = 1024
SETTLING_S: Final = (0.5, 3.0)
"""Time in which what is told follows what is estimated: a quarter of it, within these bounds."""
PACE_AFTER: Final = 0.2
"""Part of a fold's usual time that counts against the pace that was seen of it so far."""
LEAST_S: Final = 0.1
"""What is left at least of a fold that runs."""
OVERRUN: Final = 2.0
"""Factor of the usual time of a stage from which on nobody knows how long it still takes."""
OVERRUN_S: Final = 3.0
"""Seconds beyond the usual time before that is said."""
LEAST_LEFT: Final = 0.1
"""Part of its usual time that a stage still takes that is beyond it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlook:
    """What a fold has before it.

    Attributes:
        place: In the queue, 1 for the next; 0 when it does not wait.
        running: Number of folds that are computed now in its lane, while it waits.
        wait_s: About how long it waits; None when it does not, or when nobody computes.
        remaining_s: About how long until it is over, with the wait; 0 when it takes longer than
            usual, None while its modules are not counted or nobody computes.
        preparing: Progress of the workers while none of them can compute yet, or of the compiling
            fold that it waits for; None otherwise.
    """

    place: int
    running: int
    wait_s: float | None
    remaining_s: int | None
    preparing: Preparing | None = None


class Remaining:
    """Estimates for all who ask. Safe to use from many threads.

    Args:
        store: Where the rows are.
        leases: Knows the workers.
        estimates: Expected times of folds; its own if None.
        clock: Seconds since 1970.
    """

    def __init__(
        self,
        store: Store,
        leases: Leases,
        estimates: Estimates | None = None,
        *,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._store = store
        self._leases = leases
        self._estimates = estimates or Estimates(store, clock=clock)
        self._clock = clock
        self._lock = threading.Lock()
        self._told: TTLCache[str, tuple[float, float]] = TTLCache(
            MOST_KEPT, TOLD_KEPT_S, timer=clock
        )

    def of(self, row: FoldRow) -> Outlook:
        """What a fold has before it now."""
        place, running, wait = 0, 0, None
        preparing = None if row.over else self._leases.preparing()
        prepared_s = preparing.remaining_s or 0.0 if preparing is not None else 0.0
        if row.status == "queued":
            ahead = self._store.ahead(row)
            place, running = ahead.place, ahead.running
            wait = wait_s(
                ahead_s=ahead.ahead_s, running_s=ahead.running_s, at_once=self._leases.at_once()
            )
            if preparing is None and ahead.compiling is not None:
                preparing = Preparing(fraction=ahead.compiling, remaining_s=None)
            wait = None if wait is None else round(wait + prepared_s, 1)
        left = None if row.over else self._left_s(row, wait)
        if left and row.status == "running":
            left += prepared_s
        return Outlook(
            place=place,
            running=running,
            wait_s=wait,
            remaining_s=self._smoothed(row.id, left),
            preparing=preparing,
        )

    def _left_s(self, row: FoldRow, wait: float | None) -> float | None:
        """Seconds until the end; 0 beyond the usual time, None when nobody knows."""
        usual = self._estimates.stages_s(row)
        if usual is None:
            return None
        if row.status == "queued":
            # A fold that is paused begins the stage again that was cut off, and none before it.
            ahead = STAGES[STAGES.index(row.stage or STAGES[0]) :]
            return None if wait is None else wait + sum(usual.get(stage, 0.0) for stage in ahead)
        told, now = row.progress, self._clock()
        begun = told.get("stage") == row.stage  # else it is still what the stage before has said
        return left_s(
            usual,
            stage=row.stage or STAGES[0],
            fraction=float(told.get("fraction", 0.0)) if begun else 0.0,
            spent_s=told.get("stage_s", {}),
            elapsed_s=max(0.0, now - float(told.get("began_at", now))) if begun else 0.0,
            chooses=row.prefer != COMPUTING,
        )

    def _smoothed(self, fold_id: str, left: float | None) -> int | None:
        """What is told: it runs down like a clock, and leads to the estimate bit by bit."""
        now = self._clock()
        with self._lock:
            if not left:
                self._told.pop(fold_id, None)
                return None if left is None else 0
            before = self._told.get(fold_id)
            if before is not None:
                at, told = before
                down = max(0.0, told - (now - at))
                settling_s = min(max(SETTLING_S[0], down / 4.0), SETTLING_S[1])
                left = down + (left - down) * (1.0 - math.exp(-(now - at) / settling_s))
            self._told[fold_id] = (now, left)
        return max(1, round(left))


def left_s(
    usual: dict[str, float],
    *,
    stage: str,
    fraction: float,
    spent_s: dict[str, float],
    elapsed_s: float,
    chooses: bool = False,
) -> float:
    """Seconds until a fold that runs is over; 0 when its stage takes longer than usual.

    Args:
        usual: What stages usually take.
        stage: The one that runs.
        fraction: How much of it is done, as it says.
        spent_s: What it and others have taken so far, without this time.
        elapsed_s: What it has taken this time.
        chooses: Whether several plans are computed: then stages come again.
    """
    place = STAGES.index(stage)
    # The first stage says nothing of the machine's pace: it may have waited for compiled loops.
    before = STAGES[1:place]
    least = PACE_AFTER * sum(usual.values())
    known = least + sum(usual.get(other, 0.0) for other in before)
    took = least + sum(spent_s.get(other, 0.0) for other in before)
    typical = usual.get(stage, 0.0) * (1.0 if chooses else took / known)
    taken = spent_s.get(stage, 0.0) + elapsed_s
    if taken > OVERRUN * typical + OVERRUN_S:
        return 0.0
    left = max(typical - taken, LEAST_LEFT * typical)
    if chooses:
        others = TRYING if stage in TRYING else ()
        later = {other for other in (*others, *STAGES[place + 1 :]) if other != stage}
        left += sum(max(0.0, usual.get(s, 0.0) - spent_s.get(s, 0.0)) for s in later)
    else:
        if fraction > 0.0:
            left += fraction * (elapsed_s * (1.0 - fraction) / fraction - left)
        done = max(fraction, elapsed_s / (elapsed_s + left)) if elapsed_s else fraction
        pace = (took + elapsed_s) / (known + done * usual.get(stage, 0.0))
        left += pace * sum(usual.get(other, 0.0) for other in STAGES[place + 1 :])
    return max(left, LEAST_S)
