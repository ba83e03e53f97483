"""ETA: estimated remaining time of a fold, from measured durations.

Typical durations of stages come from ``server.store.estimates``. The running stage also reports its
progress: as it advances, its measured pace gains weight, also for the stages after it.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from cachetools import TTLCache

from foldback.planner.pipeline.preference import COMPUTING
from foldback.server.jobs.progress import REPEATED_STAGES, STAGES
from foldback.server.limits.fair_queue import wait_s
from foldback.server.store.estimates import Estimates
from foldback.server.store.folds import Store
from foldback.server.store.leases import Leases
from foldback.server.store.schema import FoldRow

SETTLING_RANGE_S: Final = (0.5, 3.0)
"""Smallest and largest time constant, in s, with which the displayed remaining time approaches a
new estimate; in between it is a quarter of the remaining time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class QueueEstimate:
    """Estimate of a fold's position in the queue and of its remaining time.

    Attributes:
        place: Position in the queue, from 1; 0 if the fold does not wait.
        running: Number of folds in its lane that are being computed while it waits.
        wait_s: Estimated wait, s; None if the fold does not wait or there is no worker.
        remaining_s: Estimated time to the end, including the wait, s; 0 if it takes longer than
            usual; None if its modules are not counted yet or there is no worker.
    """

    place: int
    running: int
    wait_s: float | None
    remaining_s: int | None


class EtaEstimator:
    """Estimates of remaining times. Thread-safe.

    Args:
        store: Store with the rows.
        leases: Leases of the workers.
        estimates: Expected times of folds; a new object if None.
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
        self._reported_s: TTLCache[str, tuple[float, float]] = TTLCache(
            1024,
            60.0,
            timer=clock,  # so that the next continues without a jump
        )

    def of(self, row: FoldRow) -> QueueEstimate:
        """Return the estimate for a fold."""
        place, running, wait = 0, 0, None
        if row.status == "queued":
            ahead = self._store.ahead(row)
            place, running = ahead.place, ahead.running
            wait = wait_s(
                ahead_s=ahead.ahead_s, running_s=ahead.running_s, at_once=self._leases.at_once()
            )
        remaining_s = None if row.over else self._left_s(row, wait)
        return QueueEstimate(
            place=place,
            running=running,
            wait_s=None if wait is None else round(wait, 1),
            remaining_s=self._smoothed(row.id, remaining_s),
        )

    def _left_s(self, row: FoldRow, wait: float | None) -> float | None:
        """Return the seconds to the end; 0 beyond the usual time, None if unknown."""
        usual = self._estimates.stages_s(row)
        if usual is None:
            return None
        if row.status == "queued":
            # A paused fold repeats its interrupted stage, but none before it.
            ahead = STAGES[STAGES.index(row.stage or STAGES[0]) :]
            return None if wait is None else wait + sum(usual.get(stage, 0.0) for stage in ahead)
        progress, now = row.progress, self._clock()
        is_current = (
            progress.get("stage") == row.stage
        )  # otherwise the report is of the previous stage
        return left_s(
            usual,
            stage=row.stage or STAGES[0],
            fraction=float(progress.get("fraction", 0.0)) if is_current else 0.0,
            spent_s=progress.get("stage_s", {}),
            elapsed_s=max(0.0, now - float(progress.get("began_at", now))) if is_current else 0.0,
            chooses=row.prefer != COMPUTING,
        )

    def _smoothed(self, fold_id: str, left_s: float | None) -> int | None:
        """Return the displayed time: it counts down and approaches the estimate gradually."""
        now = self._clock()
        with self._lock:
            if not left_s:
                self._reported_s.pop(fold_id, None)
                return None if left_s is None else 0
            before = self._reported_s.get(fold_id)
            if before is not None:
                at, last_s = before
                passed_s = max(0.0, now - at)  # the time of day may have been set back
                down = max(0.0, last_s - passed_s)
                settling_s = min(max(SETTLING_RANGE_S[0], down / 4.0), SETTLING_RANGE_S[1])
                left_s = down + (left_s - down) * (1.0 - math.exp(-passed_s / settling_s))
            self._reported_s[fold_id] = (now, left_s)
        return max(1, round(left_s))


def left_s(
    usual: dict[str, float],
    *,
    stage: str,
    fraction: float,
    spent_s: dict[str, float],
    elapsed_s: float,
    chooses: bool = False,
) -> float:
    """Return the remaining seconds of a running fold; 0 if its stage takes longer than usual.

    Args:
        usual: Typical seconds of each stage.
        stage: The running stage.
        fraction: Its reported progress, 0 to 1.
        spent_s: Seconds of each stage so far, without the current run.
        elapsed_s: Seconds of the current run.
        chooses: True if several plans are computed, so that stages are repeated.
    """
    place = STAGES.index(stage)
    # The first stage does not show the machine's pace: it may have waited for its process.
    before = STAGES[1:place]
    prior_s = 0.2 * sum(usual.values())  # so long it counts as running at the typical pace
    known_s = prior_s + sum(usual.get(stage_before, 0.0) for stage_before in before)
    took = prior_s + sum(spent_s.get(stage_before, 0.0) for stage_before in before)
    typical = usual.get(stage, 0.0) * (1.0 if chooses else took / known_s)
    taken_s = spent_s.get(stage, 0.0) + elapsed_s
    if taken_s > 2.0 * typical + 3.0:  # s; short stages are not late at once
        return 0.0
    stage_left_s = max(typical - taken_s, 0.1 * typical)
    if chooses:
        repeated_stages = REPEATED_STAGES if stage in REPEATED_STAGES else ()
        later = {
            later_stage
            for later_stage in (*repeated_stages, *STAGES[place + 1 :])
            if later_stage != stage
        }
        stage_left_s += sum(max(0.0, usual.get(s, 0.0) - spent_s.get(s, 0.0)) for s in later)
    else:
        if fraction > 0.0:
            stage_left_s += fraction * (elapsed_s * (1.0 - fraction) / fraction - stage_left_s)
        done = max(fraction, elapsed_s / (elapsed_s + stage_left_s)) if elapsed_s else fraction
        pace = (took + elapsed_s) / (known_s + done * usual.get(stage, 0.0))
        stage_left_s += pace * sum(
            usual.get(later_stage, 0.0) for later_stage in STAGES[place + 1 :]
        )
    return max(stage_left_s, 0.1)  # 0 means that it takes longer than usual
